/* Part of Tendon; do not edit a copy. Ceilings, which a host can tighten and never lift. */
#include "tendon_board.h"
#include "tendon_machine_private.h"

/* Ceilings of a joint. low, high: range of position; finest, coarsest: range of the encoder's step. */
typedef struct {
    float torque_limit;
    float speed;
    float tracking;
    float low;
    float high;
    float kp;
    float kd;
    float finest;
    float coarsest;
} tendon_ceiling;

static const tendon_ceiling ceilings[TENDON_JOINTS] = {TENDON_CEILINGS};

/* Remembers the first value that was lowered. */
TENDON_SMALL static void note(uint32_t place, uint32_t *lowered)
{
    if ((*lowered == 0U) || (place < *lowered)) {
        *lowered = place + 1U;
    }
}

TENDON_SMALL static float lower(float value, float ceiling, uint32_t place, uint32_t *lowered)
{
    if ((value > ceiling) && (value < TENDON_NO_LIMIT)) {
        note(place, lowered);
    }
    return (value > ceiling) ? ceiling : value;
}

TENDON_SMALL static uint32_t lower_count(uint32_t value, uint32_t ceiling, uint32_t place, uint32_t *lowered)
{
    if (value > ceiling) {
        note(place, lowered);
    }
    return (value > ceiling) ? ceiling : value;
}

uint32_t tendon_lower_drive(tendon_drive_message *drive, uint32_t *detail)
{
    uint32_t result = TENDON_RESULT_DONE;
    uint32_t lowered = 0U;
    for (uint32_t j = 0U; j < TENDON_JOINTS; ++j) {
        const tendon_ceiling *c = &ceilings[j];
        drive->kp[j] = lower(drive->kp[j], c->kp, TENDON_PLACE_DRIVE_KP + j, &lowered);
        drive->kd[j] = lower(drive->kd[j], c->kd, TENDON_PLACE_DRIVE_KD + j, &lowered);
        drive->torque_limit[j] =
            lower(drive->torque_limit[j], c->torque_limit, TENDON_PLACE_DRIVE_TORQUE_LIMIT + j, &lowered);
    }
    *detail = lowered;
    for (uint32_t j = TENDON_JOINTS; j > 0U; --j) {
        const float step = drive->position_per_count[j - 1U];
        if ((step < ceilings[j - 1U].finest) || (step > ceilings[j - 1U].coarsest)) {
            result = TENDON_RESULT_OUT_OF_RANGE;
            *detail = TENDON_PLACE_DRIVE_POSITION_PER_COUNT + (j - 1U);
        }
    }
    if (drive->velocity_gain < TENDON_LEAST_VELOCITY_GAIN) {
        result = TENDON_RESULT_OUT_OF_RANGE;
        *detail = TENDON_PLACE_DRIVE_VELOCITY_GAIN;
    }
    if ((drive->rate < TENDON_LEAST_RATE) || (drive->rate > TENDON_LARGEST_RATE)) {
        result = TENDON_RESULT_OUT_OF_RANGE;
        *detail = TENDON_PLACE_DRIVE_RATE;
    }
    return result;
}

/* A range of position outside the ceilings becomes their nearer end. */
TENDON_SMALL static void lower_range(float *low, float *high, uint32_t j, uint32_t *lowered)
{
    const tendon_ceiling *c = &ceilings[j];
    *high = lower(*high, c->high, TENDON_PLACE_SAFETY_HIGH + j, lowered);
    *high = (*high < c->low) ? c->low : *high;
    *low = -lower(-*low, -c->low, TENDON_PLACE_SAFETY_LOW + j, lowered);
    *low = (*low > c->high) ? c->high : *low;
}

void tendon_lower_safety(tendon_safety_message *safety, uint32_t *detail)
{
    uint32_t lowered = 0U;
    for (uint32_t j = 0U; j < TENDON_JOINTS; ++j) {
        const tendon_ceiling *c = &ceilings[j];
        safety->tracking[j] = lower(safety->tracking[j], c->tracking, TENDON_PLACE_SAFETY_TRACKING + j, &lowered);
        safety->speed[j] = lower(safety->speed[j], c->speed, TENDON_PLACE_SAFETY_SPEED + j, &lowered);
        lower_range(&safety->low[j], &safety->high[j], j, &lowered);
    }
    safety->silence = lower_count(safety->silence, TENDON_LONGEST_SILENCE, TENDON_PLACE_SAFETY_SILENCE, &lowered);
    safety->late = lower_count(safety->late, TENDON_LONGEST_STEP, TENDON_PLACE_SAFETY_LATE, &lowered);
    safety->early = (safety->early > safety->late) ? safety->late : safety->early;
    *detail = lowered;
}

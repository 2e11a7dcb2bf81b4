/* The two places that give a torque, under every float there is: the controller's limit, and the damping after a stop.
 * Both are in files of the firmware, which are taken as they stand. STRIDE: which part of the floats, 1 for all;
 * CASES: how many pairs of gain and limit take turns. */
#include "tendon_damping.c"
#include CONTROLLER_SOURCE

#include <math.h>
#include <stdio.h>

static const float limits[] = {1e-6f, 7.25f, 1000.0f};
static const float gains[] = {0.0f, 0.37f, 45.0f, 1e5f};

static float number(uint32_t bits)
{
    tendon_word w;
    w.bits = bits;
    return w.value;
}

static bool holds_limited(float x, float limit)
{
    uint32_t status = 0U;
    const float given = limited(x, limit, &status);
    const bool invalid = (status & TENDON_STATUS_INVALID) != 0U;
    /* As it is, or at the limit on its side; of what is no finite number, word is given, and no torque (walk.c). */
    return isfinite(x) ? (!invalid && ((given == x) ? (fabsf(x) <= limit) : (given == copysignf(limit, x)))) : invalid;
}

static bool holds_damping(tendon_machine *m, float rate, float gain, float limit)
{
    float given;
    m->config.controller.kd[0] = gain;
    m->config.controller.torque_limit[0] = limit;
    m->state.controller.qd[0] = rate;
    oppose(m);
    given = m->state.record->output.torque[0];
    /* Against the motion or none, within the limit; none of a rate that is no number. */
    return (fabsf(given) <= limit) && (isnan(rate) ? (given == 0.0f) : ((given == 0.0f) || (signbit(given) != signbit(rate))));
}

int main(void)
{
    static tendon_machine m;
    static tendon_record record;
    uint64_t wrong = 0U;
    uint64_t tried = 0U;
    m.state.record = &record;
    for (uint64_t bits = 0U; bits < (1ULL << 32); bits += STRIDE) {
        const float x = number((uint32_t)bits);
        const uint32_t k = (uint32_t)(bits % CASES);
        wrong += holds_limited(x, limits[k % 3U]) ? 0U : 1U;
        wrong += holds_damping(&m, x, gains[k], limits[k % 3U]) ? 0U : 1U;
        ++tried;
    }
    printf("tried=%llu wrong=%llu\n", (unsigned long long)tried, (unsigned long long)wrong);
    return (wrong == 0U) ? 0 : 1;
}

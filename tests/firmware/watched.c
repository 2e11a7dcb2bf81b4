/* Steps of a monitor along a motion that is made here, on whatever this is compiled for. From CHANGES on a joint's
 * model lacks friction; of every step what is said of each joint is kept, to the bit. */
#include <stdint.h>

#include "arm_monitor_f32.h"

#define JOINTS 4U
#define STEPS 24000U
#define CHANGES 8000U
#define CHANGED 2U

typedef union {
    float value;
    uint32_t bits;
} word;

void motion(void);

uint32_t results[STEPS][2U * JOINTS];
const uint32_t results_bytes = sizeof results;

void motion(void)
{
    static arm_monitor_config_f32 config;
    static arm_monitor_state_f32 state;
    static const float still[JOINTS];
    /* An oscillation a joint, by a rotation of little more than a milliradian a step and joint. */
    float cosine[JOINTS] = {1.0f, 1.0f, 1.0f, 1.0f};
    float sine[JOINTS] = {0.0f, 0.0f, 0.0f, 0.0f};
    uint32_t random = 1U;
    arm_monitor_default_f32(&config);
    arm_monitor_reset_f32(&state);
    for (uint32_t k = 0U; k < STEPS; ++k) {
        float torque[JOINTS];
        float model[JOINTS];
        float load[JOINTS];
        float qdd[JOINTS];
        for (uint32_t j = 0U; j < JOINTS; ++j) {
            const float turned = 0.004f + 0.001f * (float)j;
            cosine[j] -= turned * sine[j];
            sine[j] += turned * cosine[j];
            qdd[j] = -4.0f * sine[j];
            load[j] = 3.0f + qdd[j];
            model[j] = load[j] + cosine[j];
            random = random * 1664525U + 1013904223U;
            torque[j] = model[j] + 1.5f * ((float)(random >> 8) / 16777216.0f - 0.5f);
            if ((j == CHANGED) && (k >= CHANGES)) {
                torque[j] += (cosine[j] > 0.0f) ? 0.3f : -0.3f;
            }
        }
        arm_monitor_step_f32(&config, &state, torque, model, load, sine, cosine, qdd, still);
        for (uint32_t j = 0U; j < JOINTS; ++j) {
            const arm_watched_f32 *own = &state.joints[j];
            word band;
            band.value = own->band;
            results[k][2U * j] = band.bits;
            results[k][2U * j + 1U] = own->drifting | (own->breaking << 12) | (own->verdict << 24) | (own->signal << 28);
        }
    }
}

/* A monitor of one joint along a recorded residual, for tests that need many hours of it. */
#include <stddef.h>
#include <stdint.h>

#include "arm_monitor_f32.h"

void begin(arm_monitor_config_f32 *config, arm_monitor_state_f32 *state)
{
    arm_monitor_default_f32(config);
    arm_monitor_reset_f32(state);
}

/* Goes along the residual until the model does not hold; returns how many samples that took, `count` if it always
 * holds. With a motion (count, 3) of position, rate and acceleration, to the end: what is said after every sample,
 * verdict + 4 signal. */
uint32_t watch(
    const arm_monitor_config_f32 *config, arm_monitor_state_f32 *state, size_t count, const float *residual,
    const float *load, const float *motion, uint8_t *said)
{
    static const float steady[3] = {0.0f, 1.0f, 0.0f};
    size_t k = 0U;
    for (; (k < count) && ((motion != NULL) || (state->joints[0].verdict == ARM_MODEL_HOLDS)); ++k) {
        const float *at = (motion == NULL) ? steady : &motion[3U * k];
        arm_monitor_step_f32(config, state, &residual[k], steady, &load[k], at, at + 1, at + 2, steady);
        if (motion != NULL) {
            said[k] = (uint8_t)(state->joints[0].verdict + 4U * state->joints[0].signal);
        }
    }
    return (uint32_t)k;
}

/* Control steps along a trajectory, on whatever this is compiled for. The encoders follow what is desired, with noise;
 * of every step the torques are kept, to the bit, with phase and status. */
#include <stddef.h>
#include <stdint.h>

#include "motion.h"

#define JOINTS 4U

typedef union {
    float value;
    uint32_t bits;
} word;

void motion(void);

uint32_t results[STEPS][JOINTS + 2U];
const uint32_t results_bytes = sizeof results;

void motion(void)
{
    static vishard4_state_f32 state;
    vishard4_output_f32 output;
    int32_t counts[JOINTS];
    uint32_t random = 1U;
    vishard4_controller_prepare_f32(&config);
    for (size_t p = 0U; p < PHASES; ++p) {
        vishard4_controller_prepare_phase_f32(&phases[p]);
    }
    for (size_t j = 0U; j < JOINTS; ++j) {
        counts[j] = begin[j];
    }
    vishard4_controller_reset_f32(&state, counts);
    for (size_t k = 0U; k < STEPS; ++k) {
        vishard4_controller_step_f32(&config, &trajectory, &state, counts, &output);
        for (size_t j = 0U; j < JOINTS; ++j) {
            const int32_t desired = (int32_t)(output.q_desired[j] / config.position_per_count[j]);
            word torque;
            torque.value = output.torque[j];
            results[k][j] = torque.bits;
            random = random * 1664525U + 1013904223U;
            /* A counter may overflow. */
            counts[j] = (int32_t)((uint32_t)config.zero[j] + (uint32_t)desired + (random >> 16) % NOISE - NOISE / 2U);
        }
        results[k][JOINTS] = output.phase;
        results[k][JOINTS + 1U] = output.status;
    }
}

/* Steps of the statistics along a motion that is made here, on whatever this is compiled for; the products are kept, to
 * the bit. */
#include <stdint.h>

#include "free4_statistics_f32.h"

#define JOINTS 4U
#define STEPS 8000U

void motion(void);

free4_products_f32 results;
const uint32_t results_bytes = sizeof results;
const uint32_t state_bytes = sizeof(free4_statistics_f32);

void motion(void)
{
    static const float per_count[JOINTS] = {3.0e-5f, 3.0e-5f, 3.0e-5f, 3.0e-5f};
    static const int32_t zero[JOINTS] = {2147483600, -7, 0, 5};
    static free4_parameters_f32 parameters;
    static free4_statistics_f32 state;
    /* An oscillation a joint, by a rotation of some milliradians a step. */
    float cosine[JOINTS] = {1.0f, 1.0f, 1.0f, 1.0f};
    float sine[JOINTS] = {0.0f, 0.0f, 0.0f, 0.0f};
    free4_default_parameters_f32(&parameters);
    free4_statistics_reset_f32(&state);
    for (uint32_t k = 0U; k < STEPS; ++k) {
        float torque[JOINTS];
        int32_t counts[JOINTS];
        for (uint32_t j = 0U; j < JOINTS; ++j) {
            const float turned = 0.004f + 0.001f * (float)j;
            cosine[j] -= turned * sine[j];
            sine[j] += turned * cosine[j];
            torque[j] = cosine[j] - 3.0f * sine[j];
            counts[j] = (int32_t)((uint32_t)zero[j] + (uint32_t)(int32_t)(sine[j] * 3.0e4f));
        }
        free4_statistics_step_f32(&parameters, per_count, zero, &state, torque, counts);
    }
    for (uint32_t i = 0U; i < FREE4_STATISTICS_PRODUCTS; ++i) {
        results.high[i] = state.products.high[i];
        results.low[i] = state.products.low[i];
    }
    for (uint32_t j = 0U; j < JOINTS; ++j) {
        results.rows[j] = state.products.rows[j];
    }
}

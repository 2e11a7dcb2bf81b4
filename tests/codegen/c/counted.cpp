/* The generated C of the arm of the paper with a float that counts: prints the operations of a step for every degree. */
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

static long operations;

struct Counted {
    float v;
    Counted() = default;
    constexpr Counted(float x) : v(x) {}
    constexpr Counted(int32_t x) : v((float)x) {}
    constexpr Counted(uint32_t x) : v((float)x) {}
};
typedef Counted C;

static C operator+(C a, C b) { ++operations; return a.v + b.v; }
static C operator-(C a, C b) { ++operations; return a.v - b.v; }
static C operator*(C a, C b) { ++operations; return a.v * b.v; }
static C operator/(C a, C b) { ++operations; return a.v / b.v; }
static C operator-(C a) { return -a.v; }
static C &operator+=(C &a, C b) { return a = a + b; }
static C &operator-=(C &a, C b) { return a = a - b; }
static C &operator*=(C &a, C b) { return a = a * b; }
static bool operator<(C a, C b) { return a.v < b.v; }
static bool operator<=(C a, C b) { return a.v <= b.v; }
static bool operator>(C a, C b) { return a.v > b.v; }
static bool operator!=(C a, C b) { return a.v != b.v; }

#define float Counted
#define TENDON_MATH_F32_H
#define TENDON_COMPACT
static C tendon_abs_f32(C x) { return fabsf(x.v); }
static C tendon_min_f32(C a, C b) { return fminf(a.v, b.v); }
static C tendon_step_f32(C x) { return x.v > 0 ? 1 : 0; }
static C tendon_gate_f32(C x, C y) { return x.v > 0 ? y : 0; }
static C tendon_side_f32(C x, C a, C b) { return x.v > 0 ? a : x.v < 0 ? b : 0; }
static C tendon_rise_f32(C x) { return -expm1f(-x.v); }
static C tendon_ramp_f32(C x) { return fmaxf(x.v, 0); }
static C tendon_sgn_f32(C x) { return (x.v > 0) - (x.v < 0); }
static C tendon_sqrt_f32(C x) { return sqrtf(x.v); }
static C tendon_exp_f32(C x) { return expf(x.v); }
static C tendon_atan2_f32(C y, C x) { return atan2f(y.v, x.v); }
static C tendon_sin_f32(C x) { return sinf(x.v); }
static C tendon_cos_f32(C x) { return cosf(x.v); }
static void tendon_sincos_f32(C x, C *s, C *c) { *s = sinf(x.v); *c = cosf(x.v); }

#include "vishard4_f32.c"

#include "vishard4_controller_f32.c"

int main()
{
    static C points[4 * (VISHARD4_MAX_DEGREE + 1)];
    static vishard4_config_f32 config;
    config.rate = 1000;
    for (uint32_t degree = VISHARD4_MIN_DEGREE; degree <= VISHARD4_MAX_DEGREE; ++degree) {
        const int32_t counts[4] = {1, 2, 3, 4};
        const vishard4_phase_f32 phase = {VISHARD4_JOINT_COORDINATES, degree, 1, points, NULL};
        vishard4_trajectory_f32 trajectory = {};
        vishard4_state_f32 state;
        vishard4_output_f32 output;
        trajectory.count = 1;
        trajectory.phases = &phase;
        vishard4_controller_reset_f32(&state, counts);
        operations = 0;
        vishard4_controller_step_f32(&config, &trajectory, &state, counts, &output);
        printf("%u %ld\n", (unsigned)degree, operations);
    }
}

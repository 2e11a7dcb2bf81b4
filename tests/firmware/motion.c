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

#ifdef __arm__
/* By itself on a board that QEMU emulates: leaves the results in the file results.bin of its directory. */
void start(void);
void *memcpy(void *to, const void *from, size_t size);
void *memset(void *to, int value, size_t size);

void *memcpy(void *to, const void *from, size_t size)
{
    volatile uint8_t *target = to;
    const uint8_t *source = from;
    for (size_t i = 0U; i < size; ++i) {
        target[i] = source[i];
    }
    return to;
}

void *memset(void *to, int value, size_t size)
{
    volatile uint8_t *target = to;
    for (size_t i = 0U; i < size; ++i) {
        target[i] = (uint8_t)value;
    }
    return to;
}

typedef struct {
    void *stack;
    void (*reset)(void);
} table;

extern const table vectors;
const table vectors __attribute__((section(".vectors"), used)) = {(void *)0x20300000, start};

/* Arm's semihosting: the debugger, here the emulator, does it. */
static uint32_t ask(uint32_t operation, const void *arguments)
{
    register uint32_t r0 __asm("r0") = operation;
    register const void *r1 __asm("r1") = arguments;
    __asm volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
    return r0;
}

void start(void)
{
    static const char name[] = "results.bin";
    *(volatile uint32_t *)0xE000ED88U |= 0x00F00000U;
    __asm volatile("dsb\n\tisb" ::: "memory");
    motion();
    const uint32_t opening[3] = {(uint32_t)(uintptr_t)name, 5U, sizeof name - 1U};
    const uint32_t writing[3] = {ask(0x01U, opening), (uint32_t)(uintptr_t)results, sizeof results};
    (void)ask(0x05U, writing);
    (void)ask(0x18U, (const void *)0x20026U);
    for (;;) {
    }
}
#endif

/* Part of Tendon; do not edit a copy. Start-up. */
#include <stdint.h>

#include "tendon_board.h"

/* Start-up of a Cortex-M with a floating-point unit: vector table, memory, faults. No library is needed. */

typedef void (*vector)(void);

extern uint32_t tendon_stack_top;
extern const uint32_t tendon_data_image;
extern uint32_t tendon_data_begin;
extern uint32_t tendon_data_end;
extern uint32_t tendon_bss_begin;
extern uint32_t tendon_bss_end;

int main(void);
void tendon_reset(void);
void tendon_fault(void);

/* Top of the stack and the processor's 15 exceptions. Interrupts stay masked; the loop polls. */
typedef struct {
    uint32_t *stack;
    vector handlers[15];
} vector_table;

extern const vector_table tendon_vectors;
const vector_table tendon_vectors __attribute__((section(".vectors"), used)) = {
    &tendon_stack_top,
    {tendon_reset, tendon_fault, tendon_fault, tendon_fault, tendon_fault, tendon_fault, tendon_fault, tendon_fault,
     tendon_fault, tendon_fault, tendon_fault, tendon_fault, tendon_fault, tendon_fault, tendon_fault},
};

/* Enables the floating-point unit before any function that may use its registers. */
void tendon_reset(void)
{
    volatile uint32_t *const cpacr = (volatile uint32_t *)0xE000ED88U;
    __asm volatile("cpsid i" ::: "memory");
    *cpacr |= 0x00F00000U;
    __asm volatile("dsb\n\tisb" ::: "memory");
    const uint32_t *image = &tendon_data_image;
    uint32_t *word = &tendon_data_begin;
    while (word != &tendon_data_end) {
        *word = *image;
        ++word;
        ++image;
    }
    word = &tendon_bss_begin;
    while (word != &tendon_bss_end) {
        *word = 0U;
        ++word;
    }
    (void)main();
    for (;;) {
        /* main does not return */
    }
}

/* Handles every fault and unexpected exception. */
void tendon_fault(void)
{
    __asm volatile("cpsid i" ::: "memory");
    tendon_board_halt();
    for (;;) {
        __asm volatile("wfi");
    }
}

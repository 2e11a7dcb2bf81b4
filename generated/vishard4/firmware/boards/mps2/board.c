/* Part of Tendon; do not edit a copy. The emulated board. */
#include "tendon_board.h"

#include <stddef.h>

/* Arm's MPS2 boards as QEMU emulates them (mps2-an386: Cortex-M4F, mps2-an500: Cortex-M7). The first serial port is
 * the link to the host. The second one connects the simulated arm, which sends, once a control period,
 *     0xA5, counts[TENDON_JOINTS] i32, time_us u32, fault u32
 * and receives, after the step,
 *     0x5A, enabled u8, torque[TENDON_JOINTS] float
 * little endian. Nothing here depends on real time, so the simulation may take any time. */

typedef struct {
    volatile uint32_t data;
    volatile uint32_t state;
    volatile uint32_t control;
    volatile uint32_t interrupt; /* write 1 to clear */
    volatile uint32_t divider;
} uart;

#define LINK ((uart *)0x40004000U)
#define PLANT ((uart *)0x40005000U)
#define NVIC_ENABLE ((volatile uint32_t *)0xE000E100U)
#define NVIC_CLEAR_PENDING ((volatile uint32_t *)0xE000E280U)

#define TRANSMITTER_FULL 1U
#define RECEIVER_FULL 2U
#define BOTH_WAYS_AND_INTERRUPT_AT_A_BYTE 0x0BU
#define RECEIVED 2U
#define RECEIVERS 5U /* interrupts 0 and 2 */

#define REQUEST 0xA5U
#define ANSWER 0x5AU
#define REQUEST_BYTES ((4U * TENDON_JOINTS) + 9U)

static struct {
    uint8_t bytes[REQUEST_BYTES];
    uint32_t count;
    bool enabled;
} plant;

static bool take(const uart *port, uint8_t *byte)
{
    const bool there = (port->state & RECEIVER_FULL) != 0U;
    if (there) {
        *byte = (uint8_t)(port->data & 0xFFU);
    }
    return there;
}

static bool put(uart *port, uint8_t byte)
{
    const bool room = (port->state & TRANSMITTER_FULL) == 0U;
    if (room) {
        port->data = byte;
    }
    return room;
}

static void answer(uint8_t byte)
{
    while (!put(PLANT, byte)) {
        /* The simulated arm reads this answer. */
    }
}

static uint32_t word(size_t offset)
{
    const uint8_t *const bytes = &plant.bytes[offset];
    return (uint32_t)bytes[0] | ((uint32_t)bytes[1] << 8) | ((uint32_t)bytes[2] << 16) | ((uint32_t)bytes[3] << 24);
}

void tendon_board_start(void)
{
    LINK->divider = 16U;
    LINK->control = BOTH_WAYS_AND_INTERRUPT_AT_A_BYTE;
    PLANT->divider = 16U;
    PLANT->control = BOTH_WAYS_AND_INTERRUPT_AT_A_BYTE;
    *NVIC_ENABLE = RECEIVERS;
}

void tendon_board_wait(void)
{
    /* Cleared before the check: a byte that arrives in between sets the interrupt again, and wfi returns at once.
     * Interrupts are masked, so no handler runs. */
    LINK->interrupt = RECEIVED;
    PLANT->interrupt = RECEIVED;
    *NVIC_CLEAR_PENDING = RECEIVERS;
    if (((LINK->state | PLANT->state) & RECEIVER_FULL) == 0U) {
        __asm volatile("wfi" ::: "memory");
    }
}

bool tendon_board_period(int32_t counts[TENDON_JOINTS], uint32_t *time_us, uint32_t *fault)
{
    uint8_t byte;
    while ((plant.count < REQUEST_BYTES) && take(PLANT, &byte)) {
        if ((plant.count > 0U) || (byte == REQUEST)) {
            plant.bytes[plant.count] = byte;
            ++plant.count;
        }
    }
    const bool complete = plant.count == REQUEST_BYTES;
    if (complete) {
        for (size_t j = 0U; j < TENDON_JOINTS; ++j) {
            counts[j] = (int32_t)word(1U + (4U * j));
        }
        *time_us = word(1U + (4U * TENDON_JOINTS));
        *fault = word(5U + (4U * TENDON_JOINTS));
        plant.count = 0U;
    }
    return complete;
}

void tendon_board_enable(bool enabled)
{
    plant.enabled = enabled;
}

void tendon_board_torque(const float torque[TENDON_JOINTS])
{
    answer(ANSWER);
    answer(plant.enabled ? 1U : 0U);
    for (size_t j = 0U; j < TENDON_JOINTS; ++j) {
        union {
            float value;
            uint32_t bits;
        } as;
        as.value = torque[j];
        for (uint32_t shift = 0U; shift < 32U; shift += 8U) {
            answer((uint8_t)((as.bits >> shift) & 0xFFU));
        }
    }
}

uint32_t tendon_board_receive(uint8_t *bytes, uint32_t most)
{
    uint32_t count = 0U;
    while ((count < most) && take(LINK, &bytes[count])) {
        ++count;
    }
    return count;
}

uint32_t tendon_board_send(const uint8_t *bytes, uint32_t count)
{
    uint32_t sent = 0U;
    while ((sent < count) && put(LINK, bytes[sent])) {
        ++sent;
    }
    return sent;
}

void tendon_board_watchdog(void)
{
    /* An emulated step may take any time. */
}

void tendon_board_halt(void)
{
    static const float nothing[TENDON_JOINTS];
    plant.enabled = false;
    tendon_board_torque(nothing);
}

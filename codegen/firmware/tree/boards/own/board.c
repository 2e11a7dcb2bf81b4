/* A stub: copy this directory to boards/NAME, fill in every function, build with make BOARD=boards/NAME.
 * README.md says what each one needs on a typical microcontroller, and in which order to bring it up. */
#include "tendon_board.h"

/* 1. Clocks to full speed, the flash's cache and prefetch on.
 * 2. Drives off, and the pin that powers them driven low, before anything else may take time.
 * 3. The link: a UART at 1 Mbaud or USB-CDC, each direction with DMA or an interrupt and a ring of 256 bytes or more.
 * 4. Encoders: a timer in quadrature mode each, or SPI; their full count extended to 32 bits.
 * 5. A timer at the control rate, the same as [controller] rate in the model file; its interrupt latches all encoders
 *    and the clock, and sets the flag that tendon_board_period asks for.
 * 6. A free-running 32-bit timer at 1 MHz.
 * 7. The independent watchdog, 5 to 20 control periods long, that takes the drives' power when it bites. */
void tendon_board_start(void)
{
}

/* Sleep until an interrupt: mask interrupts, look once more whether there is a byte or a period, WFI, unmask.
 * Without this function's body the loop polls, which does no harm but heat. */
void tendon_board_wait(void)
{
}

/* True once for each tick of the control timer. Copy what the interrupt latched; interrupts masked meanwhile. If a
 * second tick came before the first was asked for, a period was missed: report true once, with the time of the second;
 * the machine sees the gap in time_us and stops the arm. */
bool tendon_board_period(int32_t counts[TENDON_JOINTS], uint32_t *time_us, uint32_t *fault)
{
    for (uint32_t j = 0U; j < TENDON_JOINTS; ++j) {
        counts[j] = 0;
    }
    *time_us = 0U;
    *fault = TENDON_NOT_READY;
    return false;
}

/* The drives' enable pin, or their bus command. Taking power away may not depend on the bus. If drives need time to
 * start, begin here; tendon_board_period reports TENDON_NOT_READY until all of them have started (also as long as they
 * are off), and a fault if they have not in time. */
void tendon_board_enable(bool enabled)
{
    (void)enabled;
}

/* Torque to current: torque[j] / (gear ratio * the motor's torque constant), with the sign of your wiring, then to the
 * current loop: PWM, DAC or bus. Clamp once more to what the motor may carry for good. */
void tendon_board_torque(const float torque[TENDON_JOINTS])
{
    (void)torque;
}

/* From the receiver's ring; 0 where it is empty. Bytes with a framing or overrun error are handed on like the others:
 * the frame's checksum rejects them, and the machine counts. */
uint32_t tendon_board_receive(uint8_t *bytes, uint32_t most)
{
    (void)bytes;
    (void)most;
    return 0U;
}

/* Into the transmitter's ring; 0 where it is full. Never wait here. */
uint32_t tendon_board_send(const uint8_t *bytes, uint32_t count)
{
    (void)bytes;
    (void)count;
    return 0U;
}

/* Restart the hardware watchdog here and nowhere else: then a loop that hangs, a timer that stops and a step that takes
 * too long all take the drives' power. */
void tendon_board_watchdog(void)
{
}

/* Drives off by writing registers: no driver, no bus, no interrupt, no floating point. */
void tendon_board_halt(void)
{
}

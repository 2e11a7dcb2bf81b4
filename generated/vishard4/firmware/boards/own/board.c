/* A stub: copy this directory to boards/NAME, fill in every function, build with make BOARD=boards/NAME.
 * src/tendon_board.h defines what each function does; README.md shows how on a typical microcontroller. */
#include "tendon_board.h"

/* The drives off first, before anything else takes time. */
void tendon_board_start(void)
{
}

/* An empty body makes the loop poll, which only costs power. */
void tendon_board_wait(void)
{
}

/* If a second period began before the first was fetched, report one, with the time of the second: the machine sees the
 * gap in time_us and stops the arm. */
bool tendon_board_period(int32_t counts[TENDON_JOINTS], uint32_t *time_us, uint32_t *fault)
{
    for (uint32_t j = 0U; j < TENDON_JOINTS; ++j) {
        counts[j] = 0;
    }
    *time_us = 0U;
    *fault = TENDON_NOT_READY;
    return false;
}

/* Switching the drives off must not depend on a bus. */
void tendon_board_enable(bool enabled)
{
    (void)enabled;
}

/* Clamp the current once more to what the motor can carry continuously. */
void tendon_board_torque(const float torque[TENDON_JOINTS])
{
    (void)torque;
}

/* Pass on bytes with framing or overrun errors too: the checksum rejects the frame, and the machine counts it. */
uint32_t tendon_board_receive(uint8_t *bytes, uint32_t most)
{
    (void)bytes;
    (void)most;
    return 0U;
}

uint32_t tendon_board_send(const uint8_t *bytes, uint32_t count)
{
    (void)bytes;
    (void)count;
    return 0U;
}

/* Restart the hardware watchdog nowhere else: it then also detects a stopped timer and a step that takes too long. */
void tendon_board_watchdog(void)
{
}

/* Write registers only: no driver, no bus, no interrupt, no floating point. */
void tendon_board_halt(void)
{
}

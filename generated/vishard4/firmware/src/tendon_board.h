/* Part of Tendon; do not edit a copy. What a board does. */
#ifndef TENDON_BOARD_H
#define TENDON_BOARD_H

#include <stdbool.h>
#include <stdint.h>

#include "tendon_arm.h"

/* What a board does for the controller of an arm. main.c calls all of this from one loop, never from an interrupt,
 * but for tendon_board_halt. boards/mps2 is a board that is emulated, boards/own a stub for yours. tendon_arm.h has the
 * arm's numbers: TENDON_JOINTS, TENDON_NOT_READY. */

/* Clocks, link, encoders, drives (off), the timer of the control period, the hardware watchdog. Called once. */
void tendon_board_start(void);

/* Sleeps until the link has a byte or a period begins; may return early. A byte or a period that came since the last
 * call of tendon_board_receive or tendon_board_period must not be slept through. */
void tendon_board_wait(void);

/* Has a control period begun since the last call? If so, and only then, gives what was measured at its beginning:
 *   counts     of the encoders, signed, free to overflow; positive in the direction of the joint's angle
 *   time_us    of a free-running microsecond clock that wraps at 2^32
 *   fault      0 if all drives would follow a torque at once; TENDON_NOT_READY if they need time, from before they are
 *              powered until then: a run waits for it; or the drives' fault code: the machine then stops the arm */
bool tendon_board_period(int32_t counts[TENDON_JOINTS], uint32_t *time_us, uint32_t *fault);

/* Powers the drives, or takes the power away. Called once a period, before tendon_board_torque. */
void tendon_board_enable(bool enabled);

/* Torques at the joints' output to hold until the next period: N m at a revolute joint, N at a prismatic one. A motor's
 * share is the torque divided by its gear ratio. Always within the limits that the host sent, always finite. */
void tendon_board_torque(const float torque[TENDON_JOINTS]);

/* Takes up to `most` bytes that the link has received; returns how many. Does not wait. */
uint32_t tendon_board_receive(uint8_t *bytes, uint32_t most);

/* Gives up to `count` bytes to the link; returns how many it took. Does not wait. */
uint32_t tendon_board_send(const uint8_t *bytes, uint32_t count);

/* A control period is done: restarts the hardware watchdog. */
void tendon_board_watchdog(void);

/* The program cannot go on: torques zero, drives off, at once, for ever. Called by fault handlers, in any state of the
 * program; it may rely on nothing but the hardware. */
void tendon_board_halt(void);

#endif

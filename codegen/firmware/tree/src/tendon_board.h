/* Part of Tendon; do not edit a copy. What a board does. */
#ifndef TENDON_BOARD_H
#define TENDON_BOARD_H

#include <stdbool.h>
#include <stdint.h>

#include "tendon_arm.h"

/* What a board does for the controller of an arm. main.c calls all of this from one loop, never from an interrupt,
 * but for tendon_board_halt. boards/mps2 is a board that is emulated, boards/own a stub for yours. tendon_arm.h has the
 * arm's numbers: TENDON_JOINTS, TENDON_NOT_READY. */

/* Ceilings: what the machine keeps to whatever a host sends, which can tighten them and never lift them. Where the
 * model file has limits, gains or a rate, those make the ceilings, in tendon_arm.h; these stand for what it leaves out,
 * and for the errors and times that it does not know. Set them to what your arm may do at most: without its first line,
 * this file is yours and is not replaced. */
#define TENDON_MOST_TORQUE 10000.0f /* N m, at a revolute joint */
#define TENDON_MOST_FORCE 10000.0f /* N, at a prismatic one */
#define TENDON_MOST_SPEED 100.0f /* rad/s, as measured and filtered */
#define TENDON_MOST_LINEAR_SPEED 10.0f /* m/s */
#define TENDON_MOST_ERROR 1.0f /* rad, from where the trajectory is */
#define TENDON_MOST_SLIP 0.5f /* m, the same */
#define TENDON_MOST_ANGLE 1000.0f /* rad, either way */
#define TENDON_MOST_TRAVEL 100.0f /* m, either way */
#define TENDON_MOST_KP 1e6f /* N m/rad or N/m */
#define TENDON_MOST_KD 1e5f /* N m s/rad or N s/m */
#define TENDON_MOST_SILENCE 1000000U /* us without a valid frame; counted in periods of the model file's rate */
#define TENDON_MOST_LATE 20000U /* us between two steps, or two periods where those are longer */
#define TENDON_MOST_RATE 1000U /* Hz, for these periods where the model file has no rate */

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
 * share is the torque divided by its gear ratio. Always within the ceilings and the limits that the host sent, always
 * finite. */
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

/* Part of Tendon; do not edit a copy. The interface of a board. */
#ifndef TENDON_BOARD_H
#define TENDON_BOARD_H

#include <stdbool.h>
#include <stdint.h>

#include "tendon_arm.h"

/* Functions that a board provides. main.c calls them from one loop, never from an interrupt; only tendon_board_halt is
 * also called by fault handlers. boards/mps2 is an emulated board, boards/own a stub for yours. tendon_arm.h defines
 * TENDON_JOINTS and TENDON_NOT_READY. */

/* Ceilings, which a host can tighten and never lift. Limits, gains and rate of the model file take precedence, in
 * tendon_arm.h; these hold for what it leaves out, and for errors and times. Set them to the limits of your arm, and
 * remove the first line of this file, so that it is not replaced. */
#define TENDON_MOST_TORQUE 10000.0f /* N m, at a revolute joint */
#define TENDON_MOST_FORCE 10000.0f /* N, at a prismatic one */
#define TENDON_MOST_SPEED 100.0f /* rad/s, as measured and filtered */
#define TENDON_MOST_LINEAR_SPEED 10.0f /* m/s */
#define TENDON_MOST_ERROR 1.0f /* rad, between desired and measured position */
#define TENDON_MOST_SLIP 0.5f /* m, the same */
#define TENDON_MOST_ANGLE 1000.0f /* rad, in either direction */
#define TENDON_MOST_TRAVEL 100.0f /* m, in either direction */
#define TENDON_MOST_KP 1e6f /* N m/rad or N/m */
#define TENDON_MOST_KD 1e5f /* N m s/rad or N s/m */
#define TENDON_MOST_SILENCE 1000000U /* us without a valid frame */
#define TENDON_MOST_LATE 20000U /* us between two steps, or two periods if those are longer */
#define TENDON_MOST_RATE 1000U /* Hz, if the model file has no rate */

/* Starts clocks, link, encoders, drives (off), control timer and hardware watchdog. Called once. */
void tendon_board_start(void);

/* Sleeps until the link has a byte or a period begins; may return early. Must return if either has happened since the
 * last call of tendon_board_receive or tendon_board_period. */
void tendon_board_wait(void);

/* Whether a control period has begun since the last call. If so, writes the measurements at its beginning:
 *   counts     of the encoders, may overflow; increasing in the direction of the joint's position
 *   time_us    of a free-running microsecond clock that wraps at 2^32
 *   fault      0 if all drives follow a torque at once; TENDON_NOT_READY before that, also while they are off; or the
 *              drives' fault code, which stops the arm */
bool tendon_board_period(int32_t counts[TENDON_JOINTS], uint32_t *time_us, uint32_t *fault);

/* Switches the drives on or off. Called once a period, before tendon_board_torque. */
void tendon_board_enable(bool enabled);

/* Applies torques until the next period, at the joints' outputs: N m at a revolute joint, N at a prismatic one. Divide
 * by the gear ratio for the motor's torque. They are finite and within the ceilings and the host's limits. */
void tendon_board_torque(const float torque[TENDON_JOINTS]);

/* Reads up to `most` received bytes without waiting. Returns their number. */
uint32_t tendon_board_receive(uint8_t *bytes, uint32_t most);

/* Passes up to `count` bytes to the link without waiting. Returns how many it accepted. */
uint32_t tendon_board_send(const uint8_t *bytes, uint32_t count);

/* Restarts the hardware watchdog. Called after each control period. */
void tendon_board_watchdog(void);

/* Torques zero and drives off, permanently. Called by fault handlers in any state of the program, so it may only rely
 * on the hardware. */
void tendon_board_halt(void);

#endif

/* Part of Tendon; do not edit a copy. Shared by the sources of the machine, not by its callers. */
#ifndef TENDON_MACHINE_PRIVATE_H
#define TENDON_MACHINE_PRIVATE_H

#include <stdbool.h>
#include <stdint.h>

#include "tendon_machine.h"

/* Calls go down this list only:
 *   tendon_step.c, tendon_link.c      the entry points: a control period, bytes from the host
 *   tendon_hold.c, tendon_upload.c    steps outside the middle of a run; settings and trajectories
 *   tendon_damping.c                  torque after a stop
 *   tendon_states.c, tendon_telemetry.c, tendon_ceilings.c, tendon_check.c
 *   tendon_guard.c                    checks that change nothing */

/* A number of periods that never pass. */
#define TENDON_ENDLESS 0xffffffffU

/* A stop that concerns no joint in particular. */
#define TENDON_NO_JOINT 0U

/* No `stop` has come since the arm stopped: larger than any sequence number. */
#define TENDON_NO_STOP 0xffffffffU

/* Magnitude of infinity; that of NaN is larger. */
#define TENDON_INFINITY 0xff000000U

/* Reports that are sent on request or after a change. */
#define TENDON_PENDING_IDENTITY 1U
#define TENDON_PENDING_STATE 2U
#define TENDON_PENDING_COUNTERS 4U

/* Unrolls a loop over the joints in the control step: their number is known, and branches would cost instructions. */
#if defined(__clang__)
#define TENDON_UNROLLED _Pragma("clang loop unroll(full)")
#elif defined(__GNUC__)
#define TENDON_UNROLLED _Pragma("GCC unroll 16")
#else
#define TENDON_UNROLLED
#endif

/* What a check found. */
typedef struct {
    uint32_t reason; /* TENDON_REASON_...; TENDON_REASON_NONE: no stop is needed */
    uint32_t joint; /* from 1, or TENDON_NO_JOINT */
    uint32_t code; /* of a drive's fault, or 0 */
} tendon_finding;

/* ---- tendon_guard.c ---- */

/* The first joint, from 1, whose encoder jumps; TENDON_NO_JOINT if none does. */
TENDON_SMALL uint32_t tendon_jumping_joint(const tendon_machine *m, const int32_t counts[TENDON_JOINTS]);

/* Before a step of the controller: board, clock, encoders, host and end of the run. */
TENDON_SMALL tendon_finding tendon_check_before_step(
    const tendon_machine *m,
    const int32_t counts[TENDON_JOINTS],
    bool untimely,
    uint32_t fault);

/* After a step of the controller: torques, tracking and the limits of the joints.
 * first     the first step of a run: every joint is inspected, and must be where the trajectory starts */
TENDON_SMALL tendon_finding tendon_check_after_step(
    const tendon_machine *m,
    const int32_t counts[TENDON_JOINTS],
    bool first);

/* ---- tendon_states.c ---- */

/* Enters STOPPED. */
TENDON_SMALL void tendon_stop(tendon_machine *m, const tendon_finding *finding);

/* The host was heard: restarts its timeout. */
TENDON_SMALL void tendon_host_heard(tendon_machine *m);

/* The commands `arm`, `run` and `reset`. Return a TENDON_RESULT_...; detail: PROTOCOL.md. */
TENDON_SMALL uint32_t tendon_command_arm(tendon_machine *m, uint32_t *detail);
TENDON_SMALL uint32_t tendon_command_run(tendon_machine *m, const uint8_t *payload);
TENDON_SMALL uint32_t tendon_command_reset(tendon_machine *m, uint32_t *detail);

/* ---- tendon_damping.c ---- */

/* Before a step of the damping: measures, and ends the damping if it can no longer be trusted. */
TENDON_SMALL void tendon_damping_update(
    tendon_machine *m,
    const int32_t counts[TENDON_JOINTS],
    bool untimely,
    uint32_t fault);

/* Outside RUNNING: torques are zero, or damp while a damping lasts; after it the drives go off. */
TENDON_SMALL void tendon_damping_apply(tendon_machine *m);

/* ---- tendon_hold.c ---- */

/* Every step that is not in the middle of a run. */
TENDON_SMALL void tendon_hold(tendon_machine *m, const int32_t counts[TENDON_JOINTS], bool untimely, uint32_t fault);

/* After a step of a run in which something was amiss: stops the arm if a check demands it. */
TENDON_SMALL void tendon_stop_if_needed(tendon_machine *m, const int32_t counts[TENDON_JOINTS]);

/* ---- tendon_ceilings.c ---- */

/* Lowers settings to the ceilings. detail: one more than the place of the first value lowered, 0 if none was; values
 * that stand for "no limit" do not count. A drive with another encoder or rate is refused; detail: which value. */
TENDON_SMALL uint32_t tendon_lower_drive(tendon_drive_message *drive, uint32_t *detail);
TENDON_SMALL void tendon_lower_safety(tendon_safety_message *safety, uint32_t *detail);

/* ---- tendon_upload.c ---- */

/* A setting (parameters, effects, drive, safety), taken as a whole or refused. */
TENDON_SMALL uint32_t tendon_take_setting(tendon_machine *m, uint32_t type, const uint8_t *payload, uint32_t *detail);

/* A part of a trajectory (trajectory, phase, points); its checksum covers the accepted parts. */
TENDON_SMALL uint32_t tendon_take_part(
    tendon_machine *m,
    uint32_t type,
    const uint8_t *payload,
    uint32_t length,
    uint32_t *detail);

/* The command `commit`. */
TENDON_SMALL uint32_t tendon_command_commit(tendon_machine *m, const uint8_t *payload, uint32_t *detail);

/* ---- tendon_telemetry.c ---- */

/* Queues the last step's record for the link, if there is room, and gives the next step another one. A step does this
 * only if nothing was sent or received since the last one. */
TENDON_SMALL void tendon_queue_record(tendon_machine *m);

/* ---- inline ---- */

/* Magnitude of a float as an integer: twice its bits. */
static inline uint32_t tendon_magnitude(float x)
{
    tendon_word w;
    w.value = x;
    return w.bits << 1;
}

/* Whether the arm is armed or running, and so can be stopped. */
static inline bool tendon_is_powered(const tendon_machine *m)
{
    return (m->state.mode == TENDON_STATE_ARMED) || (m->state.mode == TENDON_STATE_RUNNING);
}

/* Whether an encoder moved further than it can in a period. */
static inline bool tendon_has_jumped(const tendon_joint_limits *limits, int32_t from, int32_t to)
{
    const uint32_t moved = (uint32_t)to - (uint32_t)from;
    return (moved + limits->jump_counts) > (2U * limits->jump_counts);
}

/* Whether a joint's error of position exceeds its limit. */
static inline bool tendon_is_off_track(const tendon_machine *m, const tendon_record *record, uint32_t j)
{
    const float error = record->output.q_desired[j] - m->state.controller.q[j];
    return tendon_magnitude(error) > m->config.limits[j].tracking_magnitude;
}

/* Whether a joint has left its range of position. */
static inline bool tendon_is_out_of_range(const tendon_joint_limits *limits, int32_t count)
{
    return ((uint32_t)count - limits->lowest_count) > limits->range_counts;
}

/* Counts periods whose torque was limited. Returns whether there were too many in a row, or a torque is not finite. */
static inline bool tendon_is_saturated(tendon_machine *m, uint32_t status)
{
    bool exceeded = false;
    if ((status & (TENDON_STATUS_SATURATED | TENDON_STATUS_INVALID)) == 0U) {
        m->state.saturated_left_periods = m->config.safety.saturated;
    } else {
        exceeded = (m->state.saturated_left_periods == 0U) || ((status & TENDON_STATUS_INVALID) != 0U);
        --m->state.saturated_left_periods;
    }
    return exceeded;
}

#endif

/* Part of Tendon; do not edit a copy. What the files of the machine share and its callers need not know. */
#ifndef TENDON_MACHINE_PRIVATE_H
#define TENDON_MACHINE_PRIVATE_H

#include <stdbool.h>
#include <stdint.h>

#include "tendon_machine.h"

/* Periods that never pass. */
#define TENDON_ENDLESS 0xffffffffU

/* A stop that concerns no joint in particular. */
#define TENDON_NO_JOINT 0U

/* No `stop` has come since the arm stopped: more than any sequence number. */
#define TENDON_NOBODY 0xffffffffU

/* Twice the bits of an infinite float; a number that is none has more. */
#define TENDON_INFINITY 0xff000000U

/* Reports that are sent when they are asked for or have changed. */
#define TENDON_PENDING_IDENTITY 1U
#define TENDON_PENDING_STATE 2U
#define TENDON_PENDING_COUNTERS 4U

/* Before a loop over the joints in the control step: their number is known, and turns would cost instructions. */
#if defined(__clang__)
#define TENDON_UNROLLED _Pragma("clang loop unroll(full)")
#elif defined(__GNUC__)
#define TENDON_UNROLLED _Pragma("GCC unroll 16")
#else
#define TENDON_UNROLLED
#endif

/* ---- tendon_guard.c ---- */

/* The first joint, from 1, whose encoder jumps; TENDON_NO_JOINT if none does. */
TENDON_SMALL uint32_t tendon_jumping_joint(const tendon_machine *m, const int32_t counts[TENDON_JOINTS]);

/* After a step of the controller: stops the arm if it has to be, and says why. first: of a run, in which every joint is
 * looked at closely. */
TENDON_SMALL void tendon_judge(tendon_machine *m, const int32_t counts[TENDON_JOINTS], bool first);

/* Before a step of the controller: whether the board, the clock, the encoders and the host allow one; if not, the arm
 * is stopped. */
TENDON_SMALL bool tendon_allowed(
    tendon_machine *m,
    const int32_t counts[TENDON_JOINTS],
    bool untimely,
    uint32_t fault);

/* ---- tendon_damping.c ---- */

/* Before a step of the damping: whether it may go on. */
TENDON_SMALL void tendon_watch(tendon_machine *m, const int32_t counts[TENDON_JOINTS], bool untimely, uint32_t fault);

/* Nothing is followed: no torque but that of the damping after a stop, as long as it lasts; then the drives go off. */
TENDON_SMALL void tendon_coast(tendon_machine *m);

/* ---- tendon_states.c ---- */

/* To STOPPED. joint: from 1, or TENDON_NO_JOINT; code: of a drive's fault, or 0. */
TENDON_SMALL void tendon_stop(tendon_machine *m, uint32_t reason, uint32_t joint, uint32_t code);

/* The host was heard: so many periods may come until it is heard again, or until the run is over. */
TENDON_SMALL void tendon_be_patient(tendon_machine *m);

/* Every step but those in the middle of a run. */
TENDON_SMALL void tendon_hold(tendon_machine *m, const int32_t counts[TENDON_JOINTS], bool untimely, uint32_t fault);

/* The commands `arm`, `run` and `reset`: their result, and its detail. */
TENDON_SMALL uint32_t tendon_obey_arm(tendon_machine *m, uint32_t *detail);
TENDON_SMALL uint32_t tendon_obey_run(tendon_machine *m, const uint8_t *payload);
TENDON_SMALL uint32_t tendon_obey_reset(tendon_machine *m, uint32_t *detail);

/* ---- tendon_ceilings.c ---- */

/* Settings within the ceilings. detail: 0, or one more than the first value that was lowered without having been said
 * to be no limit at all; of a drive that is refused, as it tells of other encoders or another rate, which value. */
TENDON_SMALL uint32_t tendon_lower_drive(tendon_drive_message *drive, uint32_t *detail);
TENDON_SMALL void tendon_lower_safety(tendon_safety_message *safety, uint32_t *detail);

/* ---- tendon_upload.c ---- */

/* Settings (parameters, effects, drive, safety): whole or not at all. */
TENDON_SMALL uint32_t tendon_take_setting(tendon_machine *m, uint32_t type, const uint8_t *payload, uint32_t *detail);

/* A part of a trajectory (trajectory, phase, points); what was accepted counts for its checksum. */
TENDON_SMALL uint32_t tendon_take_part(
    tendon_machine *m,
    uint32_t type,
    const uint8_t *payload,
    uint32_t length,
    uint32_t *detail);

/* The command `commit`. */
TENDON_SMALL uint32_t tendon_obey_commit(tendon_machine *m, const uint8_t *payload, uint32_t *detail);

/* ---- tendon_telemetry.c ---- */

/* The record of the last step is for the link, if it has room; the next step takes the next one. No step waits for this
 * unless nothing was sent or received since the last one. */
TENDON_SMALL void tendon_settle(tendon_machine *m);

/* ---- small enough to stand where they are needed ---- */

/* A float's magnitude as a whole number: twice its bits. */
static inline uint32_t tendon_magnitude(float x)
{
    tendon_word w;
    w.value = x;
    return w.bits << 1;
}

/* Whether the arm is armed or running: it can be stopped. */
static inline bool tendon_is_powered(const tendon_machine *m)
{
    return (m->state == TENDON_STATE_ARMED) || (m->state == TENDON_STATE_RUNNING);
}

/* Whether an encoder has gone further than it can in a period. */
static inline bool tendon_jumps(const tendon_bounds *b, int32_t from, int32_t to)
{
    const uint32_t moved = (uint32_t)to - (uint32_t)from;
    return (moved + b->jump) > (2U * b->jump);
}

/* Whether a joint is not where it should be. */
static inline bool tendon_errs(const tendon_machine *m, const tendon_record *now, uint32_t j)
{
    return tendon_magnitude(now->output.q_desired[j] - m->controller.q[j]) > m->bounds[j].tracking;
}

/* Whether a joint has left its range. */
static inline bool tendon_strays(const tendon_bounds *b, int32_t counts)
{
    return ((uint32_t)counts - b->lowest) > b->range;
}

/* Whether a torque has been limited for too long, or is no number. */
static inline bool tendon_tires(tendon_machine *m, uint32_t status)
{
    bool tired = false;
    if ((status & (TENDON_STATUS_SATURATED | TENDON_STATUS_INVALID)) == 0U) {
        m->tolerance = m->safety.saturated;
    } else {
        tired = (m->tolerance == 0U) || ((status & TENDON_STATUS_INVALID) != 0U);
        --m->tolerance;
    }
    return tired;
}

#endif

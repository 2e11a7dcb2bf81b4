/* Part of Tendon; do not edit a copy. Checks whether the arm has to be stopped, and why. */
#include "tendon_machine_private.h"

uint32_t tendon_jumping_joint(const tendon_machine *m, const int32_t counts[TENDON_JOINTS])
{
    uint32_t joint = TENDON_NO_JOINT;
    for (uint32_t j = TENDON_JOINTS; j > 0U; --j) {
        if (tendon_has_jumped(&m->config.limits[j - 1U], m->state.controller.counts[j - 1U], counts[j - 1U])) {
            joint = j;
        }
    }
    return joint;
}

tendon_finding tendon_check_before_step(
    const tendon_machine *m,
    const int32_t counts[TENDON_JOINTS],
    bool untimely,
    uint32_t fault)
{
    tendon_finding found = {TENDON_REASON_NONE, TENDON_NO_JOINT, 0U};
    const uint32_t jumping = tendon_jumping_joint(m, counts);
    const bool waits = (fault == TENDON_NOT_READY) && (m->state.mode == TENDON_STATE_ARMED);
    if ((fault != 0U) && !waits) {
        found.reason = TENDON_REASON_DRIVE;
        found.code = fault;
    } else if (untimely) {
        found.reason = TENDON_REASON_WATCHDOG;
    } else if (jumping != TENDON_NO_JOINT) {
        found.reason = TENDON_REASON_ENCODER_JUMP;
        found.joint = jumping;
    } else if (m->state.until_check_periods != 0U) {
        /* Nothing found. */
    } else if ((m->state.mode == TENDON_STATE_RUNNING) && (m->state.period >= m->state.end_period)) {
        found.reason = TENDON_REASON_DONE;
    } else {
        found.reason = TENDON_REASON_LINK_LOST;
    }
    return found;
}

/* Why a joint has to be stopped. inspected: it is its turn to be inspected, as in tendon_step.c. */
TENDON_SMALL static uint32_t reason_of_joint(const tendon_machine *m, uint32_t j, int32_t count, bool inspected)
{
    const tendon_joint_limits *limits = &m->config.limits[j];
    const float commanded = m->state.record->output.q_desired[j] - m->state.watch[j].q_desired_at_change;
    uint32_t reason = TENDON_REASON_NONE;
    if (tendon_is_off_track(m, m->state.record, j)) {
        reason = TENDON_REASON_TRACKING;
    } else if (!inspected) {
        /* Its turn will come. */
    } else if (tendon_magnitude(m->state.controller.qd[j]) > limits->speed_magnitude) {
        reason = TENDON_REASON_SPEED;
    } else if (tendon_is_out_of_range(limits, count)) {
        reason = TENDON_REASON_POSITION;
    } else if (tendon_magnitude(commanded) > limits->frozen_magnitude) {
        reason = TENDON_REASON_ENCODER_FROZEN;
    } else {
        /* Within all limits. */
    }
    return reason;
}

tendon_finding tendon_check_after_step(const tendon_machine *m, const int32_t counts[TENDON_JOINTS], bool first)
{
    const tendon_output *output = &m->state.record->output;
    tendon_finding found = {TENDON_REASON_NONE, TENDON_NO_JOINT, 0U};
    /* The first joint, from 1, of each kind. */
    uint32_t not_finite = TENDON_NO_JOINT;
    uint32_t displaced = TENDON_NO_JOINT;
    uint32_t saturated = TENDON_NO_JOINT;
    for (uint32_t j = TENDON_JOINTS; j > 0U; --j) {
        const uint32_t k = j - 1U;
        const float error = output->q_desired[k] - m->state.controller.q[k];
        if (tendon_magnitude(output->q_desired[k]) >= TENDON_INFINITY) {
            not_finite = j;
        }
        if (first && (tendon_magnitude(error) > tendon_magnitude(m->config.safety.start[k]))) {
            displaced = j;
        }
        if (tendon_magnitude(output->torque[k]) >= tendon_magnitude(m->config.controller.torque_limit[k])) {
            saturated = j;
        }
    }
    if ((output->status & TENDON_STATUS_INVALID) != 0U) {
        found.reason = TENDON_REASON_NOT_FINITE;
        found.joint = not_finite;
    } else if (displaced != TENDON_NO_JOINT) {
        found.reason = TENDON_REASON_START_POSITION;
        found.joint = displaced;
    } else {
        for (uint32_t j = 0U; (j < TENDON_JOINTS) && (found.reason == TENDON_REASON_NONE); ++j) {
            const uint32_t age = (m->state.inspected_joint + TENDON_JOINTS - j) % TENDON_JOINTS;
            found.reason = reason_of_joint(m, j, counts[j], first || (age < TENDON_LOOKS));
            found.joint = j + 1U;
        }
        if ((found.reason == TENDON_REASON_NONE) && (m->state.saturated_left_periods == TENDON_ENDLESS)) {
            found.reason = TENDON_REASON_TORQUE_LIMIT;
            found.joint = saturated;
        }
    }
    return found;
}

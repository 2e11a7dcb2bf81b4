/* Part of Tendon; do not edit a copy. Whether the arm has to be stopped, and why. */
#include "tendon_machine_private.h"

uint32_t tendon_jumping_joint(const tendon_machine *m, const int32_t counts[TENDON_JOINTS])
{
    uint32_t joint = TENDON_NO_JOINT;
    for (uint32_t j = TENDON_JOINTS; j > 0U; --j) {
        if (tendon_jumps(&m->bounds[j - 1U], m->controller.counts[j - 1U], counts[j - 1U])) {
            joint = j;
        }
    }
    return joint;
}

/* Why a joint is out of its bounds; none if it is not. closely: as `look` does. */
TENDON_SMALL static uint32_t reason_of(const tendon_machine *m, uint32_t j, int32_t counts, bool closely)
{
    const tendon_bounds *b = &m->bounds[j];
    uint32_t reason = TENDON_REASON_NONE;
    if (tendon_errs(m, m->now, j)) {
        reason = TENDON_REASON_TRACKING;
    } else if (!closely) {
        /* Its turn will come. */
    } else if (tendon_magnitude(m->controller.qd[j]) > b->speed) {
        reason = TENDON_REASON_SPEED;
    } else if (tendon_strays(b, counts)) {
        reason = TENDON_REASON_POSITION;
    } else if (tendon_magnitude(m->now->output.q_desired[j] - b->mark) > b->frozen) {
        reason = TENDON_REASON_ENCODER_FROZEN;
    } else {
        /* Within all bounds. */
    }
    return reason;
}

/* The first joint whose torque has reached its limit. */
TENDON_SMALL static uint32_t limited_joint(const tendon_machine *m)
{
    uint32_t joint = TENDON_NO_JOINT;
    for (uint32_t j = TENDON_JOINTS; j > 0U; --j) {
        if (tendon_magnitude(m->now->output.torque[j - 1U]) >= tendon_magnitude(m->config.torque_limit[j - 1U])) {
            joint = j;
        }
    }
    return joint;
}

/* The first joint whose desired position is no finite number. */
TENDON_SMALL static uint32_t unknown_joint(const tendon_machine *m)
{
    uint32_t joint = TENDON_NO_JOINT;
    for (uint32_t j = TENDON_JOINTS; j > 0U; --j) {
        if (tendon_magnitude(m->now->output.q_desired[j - 1U]) >= TENDON_INFINITY) {
            joint = j;
        }
    }
    return joint;
}

void tendon_judge(tendon_machine *m, const int32_t counts[TENDON_JOINTS], bool first)
{
    if ((m->now->output.status & TENDON_STATUS_INVALID) != 0U) {
        tendon_stop(m, TENDON_REASON_NOT_FINITE, unknown_joint(m), 0U);
    } else {
        uint32_t reason = TENDON_REASON_NONE;
        uint32_t joint = TENDON_NO_JOINT;
        for (uint32_t j = 0U; (j < TENDON_JOINTS) && (reason == TENDON_REASON_NONE); ++j) {
            const bool closely = first || (((m->looked + TENDON_JOINTS - j) % TENDON_JOINTS) < TENDON_LOOKS);
            reason = reason_of(m, j, counts[j], closely);
            joint = j + 1U;
        }
        if (reason != TENDON_REASON_NONE) {
            tendon_stop(m, reason, joint, 0U);
        } else if (m->tolerance == TENDON_ENDLESS) {
            tendon_stop(m, TENDON_REASON_TORQUE_LIMIT, limited_joint(m), 0U);
        } else {
            /* Nothing is wrong. */
        }
    }
}

bool tendon_allowed(tendon_machine *m, const int32_t counts[TENDON_JOINTS], bool untimely, uint32_t fault)
{
    const uint32_t jumping = tendon_jumping_joint(m, counts);
    const bool waits = (fault == TENDON_NOT_READY) && (m->state == TENDON_STATE_ARMED);
    if ((fault != 0U) && !waits) {
        tendon_stop(m, TENDON_REASON_DRIVE, TENDON_NO_JOINT, fault);
    } else if (untimely) {
        tendon_stop(m, TENDON_REASON_WATCHDOG, TENDON_NO_JOINT, 0U);
    } else if (jumping != TENDON_NO_JOINT) {
        tendon_stop(m, TENDON_REASON_ENCODER_JUMP, jumping, 0U);
    } else if (m->left != 0U) {
        /* Go on. */
    } else if ((m->state == TENDON_STATE_RUNNING) && (m->period >= m->last)) {
        tendon_stop(m, TENDON_REASON_DONE, TENDON_NO_JOINT, 0U);
    } else {
        tendon_stop(m, TENDON_REASON_LINK_LOST, TENDON_NO_JOINT, 0U);
    }
    return tendon_is_powered(m);
}

/* Part of Tendon; do not edit a copy. Active damping after a stop. */
#include "tendon_machine_private.h"

/* Torque against the motion, within the limits; zero if the rate is not finite. */
TENDON_SMALL static void oppose(tendon_machine *m)
{
    for (uint32_t j = 0U; j < TENDON_JOINTS; ++j) {
        const float limit = m->config.controller.torque_limit[j];
        const float damping = -(m->config.controller.kd[j] * m->state.controller.qd[j]);
        float torque = 0.0f;
        if (damping > limit) {
            torque = limit;
        } else if (damping < -limit) {
            torque = -limit;
        } else if (tendon_magnitude(damping) < TENDON_INFINITY) {
            torque = damping;
        } else {
            /* NaN. */
        }
        m->state.record->output.torque[j] = torque;
    }
}

/* Whether a joint has become faster than at the stop, and than its limit, by a margin: the torque that should damp it
 * then drives it, because the sign of a motor or an encoder is wrong. NaN counts as faster. */
TENDON_SMALL static bool is_driven(const tendon_machine *m)
{
    bool found = false;
    for (uint32_t j = 0U; j < TENDON_JOINTS; ++j) {
        const uint32_t limit = m->state.watch[j].damping_speed_magnitude;
        found = found || (tendon_magnitude(m->state.controller.qd[j]) > limit);
    }
    return found;
}

void tendon_damping_update(tendon_machine *m, const int32_t counts[TENDON_JOINTS], bool untimely, uint32_t fault)
{
    bool ends = fault != 0U;
    if (untimely) {
        /* Counts over another time than a period give no rate: this step damps by the last one's. A second such step in
         * a row ends the damping, as no torque may be held. */
        ends = ends || (m->state.damped_untimely != 0U);
    } else if (tendon_jumping_joint(m, counts) != TENDON_NO_JOINT) {
        ends = true;
    } else {
        tendon_controller_measure(&m->config.controller, &m->state.controller, counts);
        ends = ends || is_driven(m);
    }
    if (ends) {
        m->state.damping_left_periods = 0U;
    }
    m->state.damped_untimely = untimely ? 1U : 0U;
}

void tendon_damping_apply(tendon_machine *m)
{
    for (uint32_t j = 0U; j < TENDON_JOINTS; ++j) {
        m->state.record->output.torque[j] = 0.0f;
    }
    if (m->state.mode == TENDON_STATE_STOPPED) {
        if (m->state.damping_left_periods != 0U) {
            --m->state.damping_left_periods;
            oppose(m);
        } else if (m->state.drives_enabled != 0U) {
            m->state.drives_enabled = 0U;
            m->state.every_record_periods = TENDON_ENDLESS;
            m->state.resume_record_periods = 0U;
            m->link.pending_reports |= TENDON_PENDING_STATE;
        } else {
            /* The drives are off already. */
        }
    }
}

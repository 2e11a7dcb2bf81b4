/* Part of Tendon; do not edit a copy. Active damping after a stop. */
#include "tendon_machine_private.h"

/* Torque against the motion, within its limits; none for what is no number. */
TENDON_SMALL static void oppose(tendon_machine *m)
{
    for (uint32_t j = 0U; j < TENDON_JOINTS; ++j) {
        const float limit = m->config.torque_limit[j];
        const float against = -(m->config.kd[j] * m->controller.qd[j]);
        float given = 0.0f;
        if (against > limit) {
            given = limit;
        } else if (against < -limit) {
            given = -limit;
        } else if (tendon_magnitude(against) < TENDON_INFINITY) {
            given = against;
        } else {
            /* No number, no torque. */
        }
        m->now->output.torque[j] = given;
    }
}

/* Whether a joint has got faster than the arm was when it was stopped, beyond its limit and a margin: what should damp
 * drives it then, because the sign of its motor or of its encoder is wrong. What is no number is faster than all. */
TENDON_SMALL static bool outruns(const tendon_machine *m)
{
    bool found = false;
    for (uint32_t j = 0U; j < TENDON_JOINTS; ++j) {
        found = found || (tendon_magnitude(m->controller.qd[j]) > m->bounds[j].outrun);
    }
    return found;
}

void tendon_watch(tendon_machine *m, const int32_t counts[TENDON_JOINTS], bool untimely, uint32_t fault)
{
    if (untimely) {
        /* What was counted in another time than a period is no rate: this step damps by that of the last one; but only
         * one step does, for no torque may be held. */
        m->damping = (m->untimely != 0U) ? 0U : m->damping;
    } else if (tendon_jumping_joint(m, counts) != TENDON_NO_JOINT) {
        m->damping = 0U;
    } else {
        tendon_controller_measure(&m->config, &m->controller, counts);
        m->damping = outruns(m) ? 0U : m->damping;
    }
    m->damping = (fault != 0U) ? 0U : m->damping;
    m->untimely = untimely ? 1U : 0U;
}

void tendon_coast(tendon_machine *m)
{
    for (uint32_t j = 0U; j < TENDON_JOINTS; ++j) {
        m->now->output.torque[j] = 0.0f;
    }
    if (m->state == TENDON_STATE_STOPPED) {
        if (m->damping != 0U) {
            --m->damping;
            oppose(m);
        } else if (m->enabled != 0U) {
            m->enabled = 0U;
            m->every = TENDON_ENDLESS;
            m->resume = 0U;
            m->pending |= TENDON_PENDING_STATE;
        } else {
            /* At rest. */
        }
    }
}

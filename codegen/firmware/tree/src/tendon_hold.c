/* Part of Tendon; do not edit a copy. The control steps that are not in the middle of a run. */
#include "tendon_machine_private.h"

/* The first step of a run. */
TENDON_SMALL static void begin(tendon_machine *m, const int32_t counts[TENDON_JOINTS])
{
    tendon_machine_state *s = &m->state;
    tendon_controller_step(
        &m->config.controller, &m->config.trajectory, &s->controller, counts, &s->record->output);
    (void)tendon_is_saturated(m, s->record->output.status);
    s->following = 1U;
    for (uint32_t j = 0U; j < TENDON_JOINTS; ++j) {
        s->watch[j].last_count = counts[j];
        s->watch[j].q_desired_at_change = s->record->output.q_desired[j];
    }
    const tendon_finding found = tendon_check_after_step(m, counts, true);
    if (found.reason != TENDON_REASON_NONE) {
        tendon_stop(m, &found);
    }
}

/* ARMED: there is no torque, but the speed is watched. */
TENDON_SMALL static void wait(tendon_machine *m, const int32_t counts[TENDON_JOINTS])
{
    tendon_finding found = {TENDON_REASON_NONE, TENDON_NO_JOINT, 0U};
    tendon_controller_measure(&m->config.controller, &m->state.controller, counts);
    for (uint32_t j = TENDON_JOINTS; j > 0U; --j) {
        if (tendon_magnitude(m->state.controller.qd[j - 1U]) > m->config.limits[j - 1U].speed_magnitude) {
            found.reason = TENDON_REASON_SPEED;
            found.joint = j;
        }
    }
    if (found.reason != TENDON_REASON_NONE) {
        tendon_stop(m, &found);
    }
}

/* Copies from the last record what this step does not compute. */
TENDON_SMALL static void copy_last_output(tendon_machine *m)
{
    const tendon_output *last = &m->state.last_record->output;
    tendon_output *output = &m->state.record->output;
    for (uint32_t j = 0U; j < TENDON_JOINTS; ++j) {
        output->q_desired[j] = last->q_desired[j];
    }
    output->phase = last->phase;
    output->status = last->status;
}

void tendon_hold(tendon_machine *m, const int32_t counts[TENDON_JOINTS], bool untimely, uint32_t fault)
{
    tendon_machine_state *s = &m->state;
    const bool first = (s->awaits_first_step != 0U) && (s->mode != TENDON_STATE_IDLE);
    /* Before the first step after `arm` there was no period to be timed. */
    const bool mistimed = untimely && !first;
    bool measured = false;
    s->drives_not_ready = (fault == TENDON_NOT_READY) ? 1U : 0U;
    if (s->record != s->last_record) {
        copy_last_output(m);
    }
    if (first) {
        tendon_controller_reset(&s->controller, counts);
        s->awaits_first_step = 0U;
    }
    if (tendon_is_powered(m)) {
        const tendon_finding found = tendon_check_before_step(m, counts, mistimed, fault);
        if (found.reason != TENDON_REASON_NONE) {
            tendon_stop(m, &found);
        } else {
            if (s->mode == TENDON_STATE_RUNNING) {
                begin(m, counts);
            } else {
                wait(m, counts);
            }
            --s->until_check_periods;
            measured = true;
        }
    }
    if (s->mode != TENDON_STATE_RUNNING) {
        if ((s->damping_left_periods != 0U) && !measured) {
            tendon_damping_update(m, counts, mistimed, fault);
        }
        tendon_damping_apply(m);
    }
    for (uint32_t j = 0U; j < TENDON_JOINTS; ++j) {
        s->controller.counts[j] = counts[j];
    }
}

void tendon_stop_if_needed(tendon_machine *m, const int32_t counts[TENDON_JOINTS])
{
    const tendon_finding found = tendon_check_after_step(m, counts, false);
    if (found.reason != TENDON_REASON_NONE) {
        tendon_stop(m, &found);
        tendon_damping_apply(m);
    }
}

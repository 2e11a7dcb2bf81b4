/* Part of Tendon; do not edit a copy. The control step in the middle of a run. */
#include "tendon_machine_private.h"

/* Inspects the joint whose turn it is: its speed, its range, and whether its encoder has stopped counting. */
static inline bool inspect_one(tendon_machine *m, const tendon_record *record, const int32_t counts[TENDON_JOINTS])
{
    const uint32_t next = m->state.inspected_joint + 1U;
    const uint32_t j = (next < TENDON_JOINTS) ? next : 0U;
    const tendon_joint_limits *limits = &m->config.limits[j];
    tendon_joint_watch *watch = &m->state.watch[j];
    const float desired = record->output.q_desired[j];
    m->state.inspected_joint = j;
    if (counts[j] != watch->last_count) {
        watch->last_count = counts[j];
        watch->q_desired_at_change = desired;
    }
    return (tendon_magnitude(m->state.controller.qd[j]) > limits->speed_magnitude)
        || tendon_is_out_of_range(limits, counts[j])
        || (tendon_magnitude(desired - watch->q_desired_at_change) > limits->frozen_magnitude);
}

/* Inspects the joints whose turn it is. */
static inline bool inspect(tendon_machine *m, const tendon_record *record, const int32_t counts[TENDON_JOINTS])
{
    bool found = false;
    TENDON_UNROLLED
    for (uint32_t k = 0U; k < TENDON_LOOKS; ++k) {
        found = found || inspect_one(m, record, counts);
    }
    return found;
}

static inline bool any_has_jumped(const tendon_machine *m, const int32_t counts[TENDON_JOINTS])
{
    bool found = false;
    TENDON_UNROLLED
    for (uint32_t j = 0U; j < TENDON_JOINTS; ++j) {
        found = found || tendon_has_jumped(&m->config.limits[j], m->state.controller.counts[j], counts[j]);
    }
    return found;
}

static inline bool any_is_off_track(const tendon_machine *m, const tendon_record *record)
{
    bool found = false;
    TENDON_UNROLLED
    for (uint32_t j = 0U; j < TENDON_JOINTS; ++j) {
        found = found || tendon_is_off_track(m, record, j);
    }
    return found;
}

void tendon_machine_step(
    tendon_machine *m,
    const int32_t counts[TENDON_JOINTS],
    uint32_t time_us,
    uint32_t fault,
    float torque[TENDON_JOINTS])
{
    tendon_machine_state *s = &m->state;
    const uint32_t passed_us = time_us - s->step_time_us;
    const bool untimely = (passed_us - m->config.safety.early) > m->config.step_window_us;
    tendon_record *record;
    if (s->until_record_periods == 0U) {
        tendon_queue_record(m);
    }
    record = s->record;
    s->step_time_us = time_us;
    if ((s->following == 0U) || (fault != 0U) || untimely || (s->until_check_periods == 0U)
        || any_has_jumped(m, counts)) {
        tendon_hold(m, counts, untimely, fault);
    } else {
        --s->until_check_periods;
        tendon_controller_step(
            &m->config.controller, &m->config.trajectory, &s->controller, counts, &record->output);
        tendon_statistics_step(&m->config.controller, &s->statistics, &record->output, counts);
        if (tendon_is_saturated(m, record->output.status) || inspect(m, record, counts)
            || any_is_off_track(m, record)) {
            tendon_stop_if_needed(m, counts);
        }
    }
    TENDON_UNROLLED
    for (uint32_t j = 0U; j < TENDON_JOINTS; ++j) {
        torque[j] = record->output.torque[j];
    }
    s->last_record = record;
    --s->until_record_periods;
    ++s->period;
}

bool tendon_machine_enabled(const tendon_machine *m)
{
    return m->state.drives_enabled != 0U;
}

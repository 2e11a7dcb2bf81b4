/* Part of Tendon; do not edit a copy. The control step in the middle of a run. */
#include "tendon_machine_private.h"

/* A closer look at one joint, another one each time: whether it is too fast, has left its range, or should have gone
 * far without one count of its encoder. */
static inline bool look_at_one(tendon_machine *m, const tendon_record *now, const int32_t counts[TENDON_JOINTS])
{
    const uint32_t j = ((m->looked + 1U) < TENDON_JOINTS) ? (m->looked + 1U) : 0U;
    tendon_bounds *b = &m->bounds[j];
    const float desired = now->output.q_desired[j];
    m->looked = j;
    if (counts[j] != b->seen) {
        b->seen = counts[j];
        b->mark = desired;
    }
    return (tendon_magnitude(m->controller.qd[j]) > b->speed) || tendon_strays(b, counts[j])
        || (tendon_magnitude(desired - b->mark) > b->frozen);
}

/* A closer look at those joints whose turn it is. */
static inline bool look(tendon_machine *m, const tendon_record *now, const int32_t counts[TENDON_JOINTS])
{
    bool found = false;
    TENDON_UNROLLED
    for (uint32_t k = 0U; k < TENDON_LOOKS; ++k) {
        found = found || look_at_one(m, now, counts);
    }
    return found;
}

static inline bool some_jump(const tendon_machine *m, const int32_t counts[TENDON_JOINTS])
{
    bool found = false;
    TENDON_UNROLLED
    for (uint32_t j = 0U; j < TENDON_JOINTS; ++j) {
        found = found || tendon_jumps(&m->bounds[j], m->controller.counts[j], counts[j]);
    }
    return found;
}

static inline bool some_err(const tendon_machine *m, const tendon_record *now)
{
    bool found = false;
    TENDON_UNROLLED
    for (uint32_t j = 0U; j < TENDON_JOINTS; ++j) {
        found = found || tendon_errs(m, now, j);
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
    const bool untimely = ((time_us - m->time_us) - m->safety.early) > m->margin;
    tendon_record *now;
    if (m->until == 0U) {
        tendon_settle(m);
    }
    now = m->now;
    m->time_us = time_us;
    if ((m->steady == 0U) || (fault != 0U) || untimely || (m->left == 0U) || some_jump(m, counts)) {
        tendon_hold(m, counts, untimely, fault);
    } else {
        --m->left;
        tendon_controller_step(&m->config, &m->trajectory, &m->controller, counts, &now->output);
        if (tendon_tires(m, now->output.status) || look(m, now, counts) || some_err(m, now)) {
            tendon_judge(m, counts, false);
            if (m->state == TENDON_STATE_STOPPED) {
                tendon_coast(m);
            }
        }
    }
    TENDON_UNROLLED
    for (uint32_t j = 0U; j < TENDON_JOINTS; ++j) {
        torque[j] = now->output.torque[j];
    }
    m->before = now;
    --m->until;
    ++m->period;
}

bool tendon_machine_enabled(const tendon_machine *m)
{
    return m->enabled != 0U;
}

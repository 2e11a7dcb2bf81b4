/* Part of Tendon; do not edit a copy. The states, and the steps that are not in the middle of a run. */
#include "tendon_machine_private.h"

/* Of two floats that are meant to be one period, the product may be less by two roundings. */
#define ONE_PERIOD 0.999999f

void tendon_stop(tendon_machine *m, uint32_t reason, uint32_t joint, uint32_t code)
{
    const bool without_torque = ((TENDON_REASONS_WITHOUT_TORQUE >> reason) & 1U) != 0U;
    m->state = TENDON_STATE_STOPPED;
    m->steady = 0U;
    m->untimely = 0U;
    m->stopper = TENDON_NOBODY;
    m->damping = without_torque ? 0U : m->safety.damping;
    m->until = 1U;
    m->resume = 0U;
    m->every = (m->every == TENDON_ENDLESS) ? 1U : m->every;
    for (uint32_t j = 0U; j < TENDON_JOINTS; ++j) {
        const uint32_t more = tendon_magnitude(TENDON_OUTRUN * m->controller.qd[j]);
        m->bounds[j].outrun = (more > m->bounds[j].speed) ? more : m->bounds[j].speed;
    }
    if (m->first != 0U) {
        /* No step since `arm`: the drives have not come on, and stay off. */
        m->enabled = 0U;
        m->damping = 0U;
        m->every = TENDON_ENDLESS;
    }
    m->report.reason = (uint8_t)reason;
    m->report.joint = (uint8_t)joint;
    m->report.code = code;
    m->report.period = m->period;
    m->pending |= TENDON_PENDING_STATE | TENDON_PENDING_COUNTERS;
    m->turn = 0U;
}

void tendon_be_patient(tendon_machine *m)
{
    const uint32_t more = m->last - m->period;
    m->left = (more < m->safety.silence) ? more : m->safety.silence;
}

/* The first step of a run: does the arm stand where the trajectory starts? */
TENDON_SMALL static void begin(tendon_machine *m, const int32_t counts[TENDON_JOINTS])
{
    tendon_controller_step(&m->config, &m->trajectory, &m->controller, counts, &m->now->output);
    const bool known = (m->now->output.status & TENDON_STATUS_INVALID) == 0U;
    (void)tendon_tires(m, m->now->output.status);
    m->steady = 1U;
    for (uint32_t j = TENDON_JOINTS; j > 0U; --j) {
        const float away = m->now->output.q_desired[j - 1U] - m->controller.q[j - 1U];
        m->bounds[j - 1U].seen = counts[j - 1U];
        m->bounds[j - 1U].mark = m->now->output.q_desired[j - 1U];
        if (known && (tendon_magnitude(away) > tendon_magnitude(m->safety.start[j - 1U]))) {
            tendon_stop(m, TENDON_REASON_START_POSITION, j, 0U);
        }
    }
    if (m->steady != 0U) {
        tendon_judge(m, counts, true);
    }
}

/* Armed: no torque, but an eye on the arm. */
TENDON_SMALL static void wait(tendon_machine *m, const int32_t counts[TENDON_JOINTS])
{
    tendon_controller_measure(&m->config, &m->controller, counts);
    for (uint32_t j = TENDON_JOINTS; j > 0U; --j) {
        if (tendon_magnitude(m->controller.qd[j - 1U]) > m->bounds[j - 1U].speed) {
            tendon_stop(m, TENDON_REASON_SPEED, j, 0U);
        }
    }
}

/* What is not measured or computed anew stays as it was in the period before. */
TENDON_SMALL static void carry(tendon_machine *m)
{
    for (uint32_t j = 0U; j < TENDON_JOINTS; ++j) {
        m->now->output.q_desired[j] = m->before->output.q_desired[j];
    }
    m->now->output.phase = m->before->output.phase;
    m->now->output.status = m->before->output.status;
}

void tendon_hold(tendon_machine *m, const int32_t counts[TENDON_JOINTS], bool untimely, uint32_t fault)
{
    const bool first = (m->first != 0U) && (m->state != TENDON_STATE_IDLE);
    /* Before the first step there was no period. */
    const bool wrong = untimely && !first;
    bool measured = false;
    m->unready = (fault == TENDON_NOT_READY) ? 1U : 0U;
    if (m->now != m->before) {
        carry(m);
    }
    if (first) {
        tendon_controller_reset(&m->controller, counts);
        m->first = 0U;
    }
    if (tendon_is_powered(m) && tendon_allowed(m, counts, wrong, fault)) {
        if (m->state == TENDON_STATE_RUNNING) {
            begin(m, counts);
        } else {
            wait(m, counts);
        }
        --m->left;
        measured = true;
    }
    if (m->state != TENDON_STATE_RUNNING) {
        if ((m->damping != 0U) && !measured) {
            tendon_watch(m, counts, wrong, fault);
        }
        tendon_coast(m);
    }
    for (uint32_t j = 0U; j < TENDON_JOINTS; ++j) {
        m->controller.counts[j] = counts[j];
    }
}

/* A position in whole counts from zero, rounded up or down; the last one that there is for what lies beyond. */
TENDON_SMALL static int32_t count_of(float position, float per_count, bool up)
{
    const float exact = position / per_count;
    int32_t counts;
    if (exact >= 2147483648.0f) {
        counts = INT32_MAX;
    } else if (exact <= -2147483648.0f) {
        counts = INT32_MIN;
    } else {
        counts = (int32_t)exact;
        if (up && ((float)counts < exact)) {
            ++counts;
        }
        if (!up && ((float)counts > exact)) {
            --counts;
        }
    }
    return counts;
}

/* The ranges of position in counts. One that holds no count at all leaves one, at its low end. */
TENDON_SMALL static void set_ranges(tendon_machine *m)
{
    for (uint32_t j = 0U; j < TENDON_JOINTS; ++j) {
        const int32_t low = count_of(m->safety.low[j], m->config.position_per_count[j], true);
        const int32_t high = count_of(m->safety.high[j], m->config.position_per_count[j], false);
        m->bounds[j].lowest = (uint32_t)m->config.zero[j] + (uint32_t)low;
        m->bounds[j].range = (high > low) ? ((uint32_t)high - (uint32_t)low) : 0U;
    }
}

uint32_t tendon_obey_arm(tendon_machine *m, uint32_t *detail)
{
    uint32_t result = TENDON_RESULT_DONE;
    if (m->missing != 0U) {
        result = TENDON_RESULT_INCOMPLETE;
        *detail = m->missing;
    } else {
        for (uint32_t k = m->trajectory.count; k > 0U; --k) {
            if ((m->phases[k - 1U].duration * m->config.rate) < ONE_PERIOD) {
                result = TENDON_RESULT_OUT_OF_RANGE;
                *detail = k - 1U;
            }
        }
    }
    if (result == TENDON_RESULT_DONE) {
        set_ranges(m);
        m->state = TENDON_STATE_ARMED;
        m->first = 1U;
        m->enabled = 1U;
        m->last = TENDON_ENDLESS;
        tendon_be_patient(m);
        m->corrupted = 0U;
        m->disordered = 0U;
        m->until = TENDON_ENDLESS;
        m->resume = 0U;
        m->every = TENDON_ENDLESS;
        m->before = m->now;
        m->now->output.phase = 0U;
        m->now->output.status = 0U;
        for (uint32_t j = 0U; j < TENDON_JOINTS; ++j) {
            m->now->output.q_desired[j] = 0.0f;
        }
        m->pending |= TENDON_PENDING_STATE;
    }
    return result;
}

uint32_t tendon_obey_run(tendon_machine *m, const uint8_t *payload)
{
    uint32_t result = TENDON_RESULT_DONE;
    tendon_run_message message;
    tendon_unpack_run(payload, &message);
    if (m->unready != 0U) {
        result = TENDON_RESULT_NOT_READY;
    } else {
        m->state = TENDON_STATE_RUNNING;
        m->period = 0U;
        m->last = (message.periods != 0U) ? message.periods : TENDON_ENDLESS;
        m->every = message.every;
        m->until = 1U;
        m->resume = 0U;
        m->tolerance = m->safety.saturated;
        m->looked = 0U;
        tendon_be_patient(m);
        m->pending |= TENDON_PENDING_STATE;
    }
    return result;
}

uint32_t tendon_obey_reset(tendon_machine *m, uint32_t *detail)
{
    uint32_t result = TENDON_RESULT_DONE;
    if (m->enabled != 0U) {
        result = TENDON_RESULT_STATE;
        *detail = m->state;
    } else {
        m->state = TENDON_STATE_IDLE;
        m->report.reason = (uint8_t)TENDON_REASON_NONE;
        m->report.joint = 0U;
        m->report.code = 0U;
        m->pending |= TENDON_PENDING_STATE;
    }
    return result;
}

uint32_t tendon_machine_size(void)
{
    return (uint32_t)sizeof(tendon_machine);
}

void tendon_machine_start(tendon_machine *m)
{
    static const tendon_counters_message none = {0U};
    m->state = TENDON_STATE_IDLE;
    m->now = &m->records[0];
    m->before = m->now;
    m->room = TENDON_TELEMETRY_RECORDS;
    m->first = 1U;
    m->period = 0U;
    m->time_us = 0U;
    m->last = TENDON_ENDLESS;
    m->steady = 0U;
    m->left = 0U;
    m->tolerance = 0U;
    m->looked = 0U;
    m->damping = 0U;
    m->enabled = 0U;
    m->until = TENDON_ENDLESS;
    m->resume = 0U;
    m->every = TENDON_ENDLESS;
    m->now->output.phase = 0U;
    m->now->output.status = 0U;
    for (uint32_t j = 0U; j < TENDON_JOINTS; ++j) {
        m->now->output.q_desired[j] = 0.0f;
        m->now->output.torque[j] = 0.0f;
        m->controller.qd[j] = 0.0f;
    }
    m->safety.errors = 0U;
    m->safety.damping = 0U;
    m->safety.silence = 0U;
    m->safety.early = 0U;
    m->margin = 0U;
    m->unready = 0U;
    m->untimely = 0U;
    m->trajectory.count = 0U;
    m->upload.open = 0U;
    m->upload.phases = 0U;
    m->upload.rows = 0U;
    m->upload.expected = 0U;
    m->missing = TENDON_MISSING_EVERYTHING;
    m->report.reason = (uint8_t)TENDON_REASON_NONE;
    m->report.joint = 0U;
    m->report.period = 0U;
    m->report.code = 0U;
    tendon_decoder_start(&m->decoder);
    m->sequence = 0U;
    m->type = 0U;
    m->stopper = TENDON_NOBODY;
    m->answer.type = 0U;
    m->answer.result = (uint8_t)TENDON_RESULT_UNKNOWN;
    m->answer.sequence = 0U;
    m->answer.detail = 0U;
    m->corrupted = 0U;
    m->disordered = 0U;
    m->counters = none;
    m->pending = TENDON_PENDING_STATE;
    m->turn = 0U;
    m->ack_head = 0U;
    m->ack_tail = 0U;
    m->record_tail = 0U;
    m->sent_frames = 0U;
    m->ready = 0U;
    m->sent = 0U;
}

/* Part of Tendon; do not edit a copy. The machine's start, and its changes of mode. */
#include "tendon_machine_private.h"

/* A phase of one period may be shorter than that by two roundings of its product with the rate. */
#define ONE_PERIOD 0.999999f

void tendon_stop(tendon_machine *m, const tendon_finding *finding)
{
    tendon_machine_state *s = &m->state;
    const bool without_torque = ((TENDON_REASONS_WITHOUT_TORQUE >> finding->reason) & 1U) != 0U;
    s->mode = TENDON_STATE_STOPPED;
    s->following = 0U;
    s->damped_untimely = 0U;
    s->damping_left_periods = without_torque ? 0U : m->config.safety.damping;
    s->until_record_periods = 1U;
    s->resume_record_periods = 0U;
    s->every_record_periods = (s->every_record_periods == TENDON_ENDLESS) ? 1U : s->every_record_periods;
    for (uint32_t j = 0U; j < TENDON_JOINTS; ++j) {
        const uint32_t margin = tendon_magnitude(TENDON_OUTRUN * s->controller.qd[j]);
        const uint32_t limit = m->config.limits[j].speed_magnitude;
        s->watch[j].damping_speed_magnitude = (margin > limit) ? margin : limit;
    }
    if (s->awaits_first_step != 0U) {
        /* No step since `arm`: the drives have not come on, and stay off. */
        s->drives_enabled = 0U;
        s->damping_left_periods = 0U;
        s->every_record_periods = TENDON_ENDLESS;
    }
    s->report.reason = (uint8_t)finding->reason;
    s->report.joint = (uint8_t)finding->joint;
    s->report.code = finding->code;
    s->report.period = s->period;
    m->link.stop_sequence = TENDON_NO_STOP;
    m->link.pending_reports |= TENDON_PENDING_STATE | TENDON_PENDING_COUNTERS;
    m->link.sent_telemetry = 0U;
}

void tendon_host_heard(tendon_machine *m)
{
    const uint32_t run_periods = m->state.end_period - m->state.period;
    const uint32_t silence_periods = m->config.safety.silence;
    m->state.until_check_periods = (run_periods < silence_periods) ? run_periods : silence_periods;
}

/* A position in whole counts from zero, rounded up or down, within what 32 bits hold. */
TENDON_SMALL static int32_t count_of(float position, float position_per_count, bool up)
{
    const float exact = position / position_per_count;
    int32_t count;
    if (exact >= 2147483648.0f) {
        count = INT32_MAX;
    } else if (exact <= -2147483648.0f) {
        count = INT32_MIN;
    } else {
        count = (int32_t)exact;
        if (up && ((float)count < exact)) {
            ++count;
        }
        if (!up && ((float)count > exact)) {
            --count;
        }
    }
    return count;
}

/* The ranges of position in counts. A range without any whole count becomes the one count at its low end. */
TENDON_SMALL static void set_ranges(tendon_machine_config *config)
{
    for (uint32_t j = 0U; j < TENDON_JOINTS; ++j) {
        const int32_t low = count_of(config->safety.low[j], config->controller.position_per_count[j], true);
        const int32_t high = count_of(config->safety.high[j], config->controller.position_per_count[j], false);
        config->limits[j].lowest_count = (uint32_t)config->controller.zero[j] + (uint32_t)low;
        config->limits[j].range_counts = (high > low) ? ((uint32_t)high - (uint32_t)low) : 0U;
    }
}

/* No telemetry is due, and the present record is empty. */
TENDON_SMALL static void clear_records(tendon_machine_state *s)
{
    s->until_record_periods = TENDON_ENDLESS;
    s->resume_record_periods = 0U;
    s->every_record_periods = TENDON_ENDLESS;
    s->last_record = s->record;
    s->record->output.phase = 0U;
    s->record->output.status = 0U;
    for (uint32_t j = 0U; j < TENDON_JOINTS; ++j) {
        s->record->output.q_desired[j] = 0.0f;
    }
}

uint32_t tendon_command_arm(tendon_machine *m, uint32_t *detail)
{
    uint32_t result = TENDON_RESULT_DONE;
    if (m->state.missing_uploads != 0U) {
        result = TENDON_RESULT_INCOMPLETE;
        *detail = m->state.missing_uploads;
    } else {
        for (uint32_t k = m->config.trajectory.count; k > 0U; --k) {
            if ((m->config.phases[k - 1U].duration * m->config.controller.rate) < ONE_PERIOD) {
                result = TENDON_RESULT_OUT_OF_RANGE;
                *detail = k - 1U;
            }
        }
    }
    if (result == TENDON_RESULT_DONE) {
        set_ranges(&m->config);
        m->state.mode = TENDON_STATE_ARMED;
        m->state.awaits_first_step = 1U;
        m->state.drives_enabled = 1U;
        m->state.end_period = TENDON_ENDLESS;
        tendon_host_heard(m);
        m->link.corrupted_frames = 0U;
        m->link.disordered_commands = 0U;
        clear_records(&m->state);
        m->link.pending_reports |= TENDON_PENDING_STATE;
    }
    return result;
}

uint32_t tendon_command_run(tendon_machine *m, const uint8_t *payload)
{
    uint32_t result = TENDON_RESULT_DONE;
    tendon_run_message message;
    tendon_unpack_run(payload, &message);
    if (m->state.drives_not_ready != 0U) {
        result = TENDON_RESULT_NOT_READY;
    } else {
        m->state.mode = TENDON_STATE_RUNNING;
        m->state.period = 0U;
        m->state.end_period = (message.periods != 0U) ? message.periods : TENDON_ENDLESS;
        m->state.every_record_periods = message.every;
        m->state.until_record_periods = 1U;
        m->state.resume_record_periods = 0U;
        m->state.saturated_left_periods = m->config.safety.saturated;
        m->state.inspected_joint = 0U;
        tendon_statistics_restart(&m->state.statistics);
        tendon_host_heard(m);
        m->link.pending_reports |= TENDON_PENDING_STATE;
    }
    return result;
}

/* Forgets the reason of the last stop. */
TENDON_SMALL static void enter_idle(tendon_machine *m)
{
    m->state.mode = TENDON_STATE_IDLE;
    m->state.report.reason = (uint8_t)TENDON_REASON_NONE;
    m->state.report.joint = 0U;
    m->state.report.code = 0U;
    m->link.pending_reports |= TENDON_PENDING_STATE;
}

uint32_t tendon_command_reset(tendon_machine *m, uint32_t *detail)
{
    uint32_t result = TENDON_RESULT_DONE;
    if (m->state.drives_enabled != 0U) {
        result = TENDON_RESULT_STATE;
        *detail = m->state.mode;
    } else {
        enter_idle(m);
    }
    return result;
}

uint32_t tendon_machine_size(void)
{
    return (uint32_t)sizeof(tendon_machine);
}

void tendon_machine_start(tendon_machine *m)
{
    uint8_t *bytes = (uint8_t *)m;
    for (uint32_t k = 0U; k < (uint32_t)sizeof(tendon_machine); ++k) {
        bytes[k] = 0U;
    }
    m->state.awaits_first_step = 1U;
    m->state.end_period = TENDON_ENDLESS;
    m->state.missing_uploads = TENDON_MISSING_EVERYTHING;
    m->state.record = &m->link.records[0];
    clear_records(&m->state);
    m->link.stop_sequence = TENDON_NO_STOP;
    m->link.answer.result = (uint8_t)TENDON_RESULT_UNKNOWN;
    m->link.free_records = TENDON_TELEMETRY_RECORDS;
    enter_idle(m);
}

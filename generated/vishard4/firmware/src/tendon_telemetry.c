/* Part of Tendon; do not edit a copy. Records of control periods, and the reports to the host. */
#include "tendon_machine_private.h"

#define REASON_SHIFT 8U /* bits below the reason in a record's `mode_and_reason` */

void tendon_queue_record(tendon_machine *m)
{
    tendon_machine_state *s = &m->state;
    if (s->until_record_periods == 0U) {
        tendon_record *record = s->record;
        const bool resumes = s->resume_record_periods != 0U;
        s->until_record_periods = resumes ? s->resume_record_periods : s->every_record_periods;
        s->resume_record_periods = 0U;
        if (m->link.free_records > 0U) {
            const bool is_last = record == &m->link.records[TENDON_TELEMETRY_RECORDS];
            for (uint32_t j = 0U; j < TENDON_JOINTS; ++j) {
                record->counts[j] = s->controller.counts[j];
            }
            record->period = s->period - 1U;
            record->time_us = s->step_time_us;
            record->mode_and_reason = s->mode | ((uint32_t)s->report.reason << REASON_SHIFT);
            s->record = is_last ? &m->link.records[0] : &record[1];
            --m->link.free_records;
        } else {
            ++m->link.counters.telemetry_lost;
        }
    }
}

/* Adds header and checksum to the payload in `plain`, and encodes the frame into `wire`. */
TENDON_SMALL static void wrap(tendon_link *link, uint32_t type, uint32_t length, uint8_t plain[TENDON_PLAIN_BYTES])
{
    const uint32_t body = TENDON_HEADER + length;
    tendon_put_u8(&plain[TENDON_PLACE_HEADER_VERSION], TENDON_PROTOCOL_VERSION);
    tendon_put_u8(&plain[TENDON_PLACE_HEADER_TYPE], type);
    tendon_put_u16(&plain[TENDON_PLACE_HEADER_SEQUENCE], link->report_sequence);
    tendon_put_u16(&plain[TENDON_PLACE_HEADER_LENGTH], length);
    tendon_put_u32(&plain[body], tendon_crc32(0U, plain, body));
    link->wire_bytes = tendon_cobs_encode(plain, body + TENDON_CHECKSUM, link->wire);
    link->wire_sent_bytes = 0U;
    ++link->report_sequence;
}

TENDON_SMALL static void report_identity(tendon_machine *m, uint8_t plain[TENDON_PLAIN_BYTES])
{
    const tendon_identity_message identity = {
        (uint8_t)TENDON_PROTOCOL_VERSION, (uint8_t)TENDON_JOINTS, (uint8_t)m->state.mode, m->state.report.reason,
        TENDON_FINGERPRINT, (uint16_t)TENDON_MAX_PHASES, (uint16_t)TENDON_MAX_ROWS,
        TENDON_BUILD};
    tendon_pack_identity(&identity, &plain[TENDON_HEADER]);
    m->link.pending_reports &= ~TENDON_PENDING_IDENTITY;
    wrap(&m->link, TENDON_REPORT_IDENTITY, TENDON_SIZE_IDENTITY, plain);
}

TENDON_SMALL static void report_telemetry(tendon_machine *m, uint8_t plain[TENDON_PLAIN_BYTES])
{
    tendon_link *link = &m->link;
    const tendon_record *record = &link->records[link->record_tail];
    tendon_telemetry_message telemetry;
    telemetry.period = record->period;
    telemetry.time_us = record->time_us;
    for (uint32_t j = 0U; j < TENDON_JOINTS; ++j) {
        telemetry.counts[j] = record->counts[j];
        telemetry.torque[j] = record->output.torque[j];
        telemetry.q_desired[j] = record->output.q_desired[j];
    }
    telemetry.phase = (uint8_t)record->output.phase;
    telemetry.status = (uint8_t)record->output.status;
    telemetry.state = (uint8_t)(record->mode_and_reason & 255U);
    telemetry.reason = (uint8_t)(record->mode_and_reason >> REASON_SHIFT);
    tendon_take_watched(&m->state.controller, &telemetry);
    tendon_pack_telemetry(&telemetry, &plain[TENDON_HEADER]);
    link->record_tail = (link->record_tail < TENDON_TELEMETRY_RECORDS) ? (link->record_tail + 1U) : 0U;
    ++link->free_records;
    link->sent_telemetry = 1U;
    wrap(link, TENDON_REPORT_TELEMETRY, TENDON_SIZE_TELEMETRY, plain);
}

/* Encodes the next report into `wire`; false if there is none. Telemetry alternates with the other reports, so that the
 * last record of a run precedes the reason of its stop and neither waits for long. */
TENDON_SMALL static bool next_report(tendon_machine *m)
{
    tendon_link *link = &m->link;
    uint8_t plain[TENDON_PLAIN_BYTES];
    uint8_t *payload = &plain[TENDON_HEADER];
    const bool has_record = link->free_records < TENDON_TELEMETRY_RECORDS;
    const bool has_block = tendon_statistics_asked(&m->state.statistics) != 0U;
    const bool others = (link->pending_reports != 0U) || has_block;
    bool found = true;
    if (link->ack_head != link->ack_tail) {
        tendon_pack_ack(&link->acks[link->ack_tail % TENDON_ACKS], payload);
        ++link->ack_tail;
        wrap(link, TENDON_REPORT_ACK, TENDON_SIZE_ACK, plain);
    } else if ((link->pending_reports & TENDON_PENDING_IDENTITY) != 0U) {
        report_identity(m, plain);
    } else if (has_record && ((link->sent_telemetry == 0U) || (!others))) {
        report_telemetry(m, plain);
    } else if ((link->pending_reports & TENDON_PENDING_STATE) != 0U) {
        m->state.report.state = (uint8_t)m->state.mode;
        m->state.report.enabled = (uint8_t)m->state.drives_enabled;
        tendon_pack_state(&m->state.report, payload);
        link->pending_reports &= ~TENDON_PENDING_STATE;
        link->sent_telemetry = 0U;
        wrap(link, TENDON_REPORT_STATE, TENDON_SIZE_STATE, plain);
    } else if ((link->pending_reports & TENDON_PENDING_COUNTERS) != 0U) {
        tendon_pack_counters(&link->counters, payload);
        link->pending_reports &= ~TENDON_PENDING_COUNTERS;
        link->sent_telemetry = 0U;
        wrap(link, TENDON_REPORT_COUNTERS, TENDON_SIZE_COUNTERS, plain);
    } else if (has_block) {
        const uint32_t size = tendon_take_block(&m->state.statistics, payload);
        link->sent_telemetry = 0U;
        wrap(link, TENDON_REPORT_STATISTICS, size, plain);
    } else {
        found = false;
    }
    return found;
}

uint32_t tendon_machine_send(tendon_machine *m, uint8_t *bytes, uint32_t most)
{
    uint32_t count = 0U;
    bool more = true;
    tendon_queue_record(m);
    while (more && (count < most)) {
        if (m->link.wire_sent_bytes < m->link.wire_bytes) {
            bytes[count] = m->link.wire[m->link.wire_sent_bytes];
            ++m->link.wire_sent_bytes;
            ++count;
        } else {
            more = next_report(m);
        }
    }
    return count;
}

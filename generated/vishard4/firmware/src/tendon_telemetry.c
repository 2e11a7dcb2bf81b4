/* Part of Tendon; do not edit a copy. Records of control periods, and the reports to the host. */
#include "tendon_machine_private.h"

#define REASON 8U /* bits of a record's `standing` before the reason */

void tendon_settle(tendon_machine *m)
{
    if (m->until == 0U) {
        tendon_record *now = m->now;
        m->until = (m->resume != 0U) ? m->resume : m->every;
        m->resume = 0U;
        if (m->room > 0U) {
            for (uint32_t j = 0U; j < TENDON_JOINTS; ++j) {
                now->counts[j] = m->controller.counts[j];
            }
            now->period = m->period - 1U;
            now->time_us = m->time_us;
            now->standing = m->state | ((uint32_t)m->report.reason << REASON);
            m->now = (now == &m->records[TENDON_TELEMETRY_RECORDS]) ? &m->records[0] : &now[1];
            --m->room;
        } else {
            ++m->counters.telemetry_lost;
        }
    }
}

/* Frames the payload that stands behind the header in `plain`. */
TENDON_SMALL static void wrap(tendon_machine *m, uint32_t type, uint32_t length, uint8_t plain[TENDON_PLAIN_BYTES])
{
    const uint32_t body = TENDON_HEADER + length;
    tendon_put_u8(&plain[TENDON_PLACE_HEADER_VERSION], TENDON_PROTOCOL_VERSION);
    tendon_put_u8(&plain[TENDON_PLACE_HEADER_TYPE], type);
    tendon_put_u16(&plain[TENDON_PLACE_HEADER_SEQUENCE], m->sent_frames);
    tendon_put_u16(&plain[TENDON_PLACE_HEADER_LENGTH], length);
    tendon_put_u32(&plain[body], tendon_crc32(0U, plain, body));
    m->ready = tendon_cobs_encode(plain, body + TENDON_CHECKSUM, m->wire);
    m->sent = 0U;
    ++m->sent_frames;
}

TENDON_SMALL static void report_identity(tendon_machine *m, uint8_t plain[TENDON_PLAIN_BYTES])
{
    const tendon_identity_message identity = {
        (uint8_t)TENDON_PROTOCOL_VERSION, (uint8_t)TENDON_JOINTS, (uint8_t)m->state, m->report.reason,
        TENDON_FINGERPRINT, (uint16_t)TENDON_MAX_PHASES, (uint16_t)TENDON_MAX_ROWS,
        TENDON_BUILD};
    tendon_pack_identity(&identity, &plain[TENDON_HEADER]);
    m->pending &= ~TENDON_PENDING_IDENTITY;
    wrap(m, TENDON_REPORT_IDENTITY, TENDON_SIZE_IDENTITY, plain);
}

TENDON_SMALL static void report_telemetry(tendon_machine *m, uint8_t plain[TENDON_PLAIN_BYTES])
{
    const tendon_record *r = &m->records[m->record_tail];
    tendon_telemetry_message telemetry;
    telemetry.period = r->period;
    telemetry.time_us = r->time_us;
    for (uint32_t j = 0U; j < TENDON_JOINTS; ++j) {
        telemetry.counts[j] = r->counts[j];
        telemetry.torque[j] = r->output.torque[j];
        telemetry.q_desired[j] = r->output.q_desired[j];
    }
    telemetry.phase = (uint8_t)r->output.phase;
    telemetry.status = (uint8_t)r->output.status;
    telemetry.state = (uint8_t)(r->standing & 255U);
    telemetry.reason = (uint8_t)(r->standing >> REASON);
    tendon_pack_telemetry(&telemetry, &plain[TENDON_HEADER]);
    m->record_tail = (m->record_tail < TENDON_TELEMETRY_RECORDS) ? (m->record_tail + 1U) : 0U;
    ++m->room;
    m->turn = 1U;
    wrap(m, TENDON_REPORT_TELEMETRY, TENDON_SIZE_TELEMETRY, plain);
}

/* The next report into `wire`. Telemetry and the state take turns, so that a stop's last record comes before its
 * reason, and neither waits for long. */
TENDON_SMALL static bool next_report(tendon_machine *m)
{
    uint8_t plain[TENDON_PLAIN_BYTES];
    uint8_t *payload = &plain[TENDON_HEADER];
    const bool recorded = m->room < TENDON_TELEMETRY_RECORDS;
    bool found = true;
    if (m->ack_head != m->ack_tail) {
        tendon_pack_ack(&m->acks[m->ack_tail % TENDON_ACKS], payload);
        ++m->ack_tail;
        wrap(m, TENDON_REPORT_ACK, TENDON_SIZE_ACK, plain);
    } else if ((m->pending & TENDON_PENDING_IDENTITY) != 0U) {
        report_identity(m, plain);
    } else if (recorded && ((m->turn == 0U) || (m->pending == 0U))) {
        report_telemetry(m, plain);
    } else if ((m->pending & TENDON_PENDING_STATE) != 0U) {
        m->report.state = (uint8_t)m->state;
        m->report.enabled = (uint8_t)m->enabled;
        tendon_pack_state(&m->report, payload);
        m->pending &= ~TENDON_PENDING_STATE;
        m->turn = 0U;
        wrap(m, TENDON_REPORT_STATE, TENDON_SIZE_STATE, plain);
    } else if ((m->pending & TENDON_PENDING_COUNTERS) != 0U) {
        tendon_pack_counters(&m->counters, payload);
        m->pending &= ~TENDON_PENDING_COUNTERS;
        m->turn = 0U;
        wrap(m, TENDON_REPORT_COUNTERS, TENDON_SIZE_COUNTERS, plain);
    } else {
        found = false;
    }
    return found;
}

uint32_t tendon_machine_send(tendon_machine *m, uint8_t *bytes, uint32_t most)
{
    uint32_t count = 0U;
    bool more = true;
    tendon_settle(m);
    while (more && (count < most)) {
        if (m->sent < m->ready) {
            bytes[count] = m->wire[m->sent];
            ++m->sent;
            ++count;
        } else {
            more = next_report(m);
        }
    }
    return count;
}

/* Part of Tendon; do not edit a copy. Frames and commands from the host. */
#include "tendon_check.h"
#include "tendon_machine_private.h"

TENDON_SMALL static void stop(tendon_machine *m, uint32_t reason)
{
    const tendon_finding found = {reason, TENDON_NO_JOINT, 0U};
    tendon_stop(m, &found);
}

/* Counts a frame that cannot be read. More of them than `safety.errors` stop the arm. */
TENDON_SMALL static void reject_frame(tendon_machine *m, uint32_t *counter)
{
    ++*counter;
    if (tendon_is_powered(m)) {
        ++m->link.corrupted_frames;
        if (m->link.corrupted_frames > m->config.safety.errors) {
            stop(m, TENDON_REASON_CORRUPTED);
        }
    }
}

/* Executes a command that is next in sequence. Returns its result. */
TENDON_SMALL static uint32_t execute(
    tendon_machine *m,
    uint32_t type,
    const uint8_t *payload,
    uint32_t length,
    uint32_t *detail)
{
    uint32_t result = tendon_check_command(type, length, payload, m->state.mode, detail);
    if (result == TENDON_RESULT_DONE) {
        switch (type) {
        case TENDON_COMMAND_PARAMETERS:
        case TENDON_COMMAND_EFFECTS:
        case TENDON_COMMAND_DRIVE:
        case TENDON_COMMAND_SAFETY:
            result = tendon_take_setting(m, type, payload, detail);
            break;
        case TENDON_COMMAND_TRAJECTORY:
        case TENDON_COMMAND_PHASE:
        case TENDON_COMMAND_POINTS:
            result = tendon_take_part(m, type, payload, length, detail);
            break;
        case TENDON_COMMAND_COMMIT:
            result = tendon_command_commit(m, payload, detail);
            break;
        case TENDON_COMMAND_ARM:
            result = tendon_command_arm(m, detail);
            break;
        case TENDON_COMMAND_RUN:
            result = tendon_command_run(m, payload);
            break;
        case TENDON_COMMAND_STOP:
            if (tendon_is_powered(m)) {
                stop(m, TENDON_REASON_HOST);
            } else if (m->link.stop_sequence != TENDON_NO_STOP) {
                /* The second `stop` ends the damping. */
                m->state.damping_left_periods = 0U;
            } else {
                /* The arm has stopped by itself, and the host may not know yet. */
            }
            break;
        case TENDON_COMMAND_RESET:
            result = tendon_command_reset(m, detail);
            break;
        case TENDON_COMMAND_HELLO:
            m->link.pending_reports |= TENDON_PENDING_IDENTITY;
            break;
        case TENDON_COMMAND_QUERY:
            if (m->state.until_record_periods > 1U) {
                /* Inserts a record; the regular ones keep their times. */
                m->state.resume_record_periods = m->state.until_record_periods - 1U;
                m->state.until_record_periods = 1U;
            }
            m->link.pending_reports |= TENDON_PENDING_STATE | TENDON_PENDING_COUNTERS;
            tendon_statistics_ask(&m->state.statistics);
            break;
        case TENDON_COMMAND_ALIVE: /* its frame has restarted the timeout */
        default: /* tendon_check_command knows no other */
            break;
        }
    }
    return result;
}

TENDON_SMALL static void acknowledge(tendon_link *link, const tendon_ack_message *answer)
{
    if ((link->ack_head - link->ack_tail) < TENDON_ACKS) {
        link->acks[link->ack_head % TENDON_ACKS] = *answer;
        ++link->ack_head;
    } else {
        /* The host repeats the command and is answered then. */
        ++link->counters.acks_lost;
    }
}

/* A command in a valid frame: executed once and in sequence, or answered again, or refused. */
TENDON_SMALL static void obey(
    tendon_machine *m,
    uint32_t type,
    uint32_t sequence,
    const uint8_t *payload,
    uint32_t length)
{
    tendon_link *link = &m->link;
    const uint32_t expected = (link->sequence + 1U) & 0xffffU;
    const bool restarts = (type == TENDON_COMMAND_STOP) || ((type == TENDON_COMMAND_HELLO) && !tendon_is_powered(m));
    uint32_t detail = 0U;
    const bool stopped = m->state.mode == TENDON_STATE_STOPPED;
    if ((type == TENDON_COMMAND_STOP) && stopped && (sequence == link->stop_sequence)) {
        const tendon_ack_message answer = {(uint8_t)type, (uint8_t)TENDON_RESULT_DONE, (uint16_t)sequence, 0U};
        ++link->counters.duplicates;
        acknowledge(link, &answer);
    } else if (restarts || (sequence == expected)) {
        const uint32_t result = execute(m, type, payload, length, &detail);
        link->sequence = sequence;
        link->type = type;
        link->stop_sequence = (type == TENDON_COMMAND_STOP) ? sequence : link->stop_sequence;
        link->answer.type = (uint8_t)type;
        link->answer.result = (uint8_t)result;
        link->answer.sequence = (uint16_t)sequence;
        link->answer.detail = (uint16_t)detail;
        if (result == TENDON_RESULT_UNKNOWN) {
            ++link->counters.unknown;
        } else if (result != TENDON_RESULT_DONE) {
            ++link->counters.refused;
        } else {
            /* Done. */
        }
        acknowledge(link, &link->answer);
    } else if ((sequence == link->sequence) && (type == link->type)) {
        ++link->counters.duplicates;
        acknowledge(link, &link->answer);
    } else {
        const tendon_ack_message answer = {
            (uint8_t)type, (uint8_t)TENDON_RESULT_SEQUENCE, (uint16_t)sequence, (uint16_t)expected};
        ++link->counters.out_of_order;
        acknowledge(link, &answer);
        if (tendon_is_powered(m)) {
            ++link->disordered_commands;
            if (link->disordered_commands > m->config.safety.errors) {
                stop(m, TENDON_REASON_SEQUENCE);
            }
        }
    }
}

/* A frame that COBS has decoded. */
TENDON_SMALL static void read_frame(tendon_machine *m)
{
    const uint8_t *frame = m->link.frame;
    const uint32_t count = m->link.decoder.count;
    if (count < (TENDON_HEADER + TENDON_CHECKSUM)) {
        reject_frame(m, &m->link.counters.bad_frame);
    } else {
        const uint32_t body = count - TENDON_CHECKSUM;
        const uint32_t version = frame[TENDON_PLACE_HEADER_VERSION];
        const uint32_t type = frame[TENDON_PLACE_HEADER_TYPE];
        const uint32_t length = tendon_get_u16(&frame[TENDON_PLACE_HEADER_LENGTH]);
        if (tendon_crc32(0U, frame, body) != tendon_get_u32(&frame[body])) {
            reject_frame(m, &m->link.counters.bad_crc);
        } else if ((TENDON_HEADER + length) != body) {
            reject_frame(m, &m->link.counters.bad_header);
        } else if ((version != TENDON_PROTOCOL_VERSION) && (type != TENDON_COMMAND_HELLO)) {
            reject_frame(m, &m->link.counters.bad_header);
        } else {
            tendon_host_heard(m);
            obey(m, type, tendon_get_u16(&frame[TENDON_PLACE_HEADER_SEQUENCE]), &frame[TENDON_HEADER], length);
        }
    }
}

void tendon_machine_receive(tendon_machine *m, const uint8_t *bytes, uint32_t count)
{
    tendon_queue_record(m);
    for (uint32_t k = 0U; k < count; ++k) {
        const tendon_frame_event event =
            tendon_decoder_put(&m->link.decoder, m->link.frame, TENDON_FRAME_BYTES, bytes[k]);
        if (event == TENDON_FRAME_WHOLE) {
            read_frame(m);
        } else if (event == TENDON_FRAME_BROKEN) {
            reject_frame(m, &m->link.counters.bad_frame);
        } else {
            /* The frame continues. */
        }
    }
}

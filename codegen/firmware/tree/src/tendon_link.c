/* Part of Tendon; do not edit a copy. Frames and commands from the host. */
#include "tendon_check.h"
#include "tendon_machine_private.h"

/* A frame that cannot be read. Some noise is tolerated. */
TENDON_SMALL static void corrupted(tendon_machine *m, uint32_t *counter)
{
    ++*counter;
    if (tendon_is_powered(m)) {
        ++m->corrupted;
        if (m->corrupted > m->safety.errors) {
            tendon_stop(m, TENDON_REASON_CORRUPTED, TENDON_NO_JOINT, 0U);
        }
    }
}

/* A command that is in order. Returns its result. */
TENDON_SMALL static uint32_t execute(
    tendon_machine *m,
    uint32_t type,
    const uint8_t *payload,
    uint32_t length,
    uint32_t *detail)
{
    uint32_t result = tendon_check_command(type, length, payload, m->state, detail);
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
            result = tendon_obey_commit(m, payload, detail);
            break;
        case TENDON_COMMAND_ARM:
            result = tendon_obey_arm(m, detail);
            break;
        case TENDON_COMMAND_RUN:
            result = tendon_obey_run(m, payload);
            break;
        case TENDON_COMMAND_STOP:
            if (tendon_is_powered(m)) {
                tendon_stop(m, TENDON_REASON_HOST, TENDON_NO_JOINT, 0U);
            } else if (m->stopper != TENDON_NOBODY) {
                /* It has been asked to stop before: not even damping is wanted. */
                m->damping = 0U;
            } else {
                /* It has stopped by itself, which the host may not have heard yet. */
            }
            break;
        case TENDON_COMMAND_RESET:
            result = tendon_obey_reset(m, detail);
            break;
        case TENDON_COMMAND_HELLO:
            m->pending |= TENDON_PENDING_IDENTITY;
            break;
        case TENDON_COMMAND_QUERY:
            if (m->until > 1U) {
                /* One record more; those of a run come when they would have. */
                m->resume = m->until - 1U;
                m->until = 1U;
            }
            m->pending |= TENDON_PENDING_STATE | TENDON_PENDING_COUNTERS;
            break;
        case TENDON_COMMAND_ALIVE: /* the frame was enough */
        default: /* there is no other */
            break;
        }
    }
    return result;
}

TENDON_SMALL static void acknowledge(tendon_machine *m, const tendon_ack_message *answer)
{
    if ((m->ack_head - m->ack_tail) < TENDON_ACKS) {
        m->acks[m->ack_head % TENDON_ACKS] = *answer;
        ++m->ack_head;
    } else {
        /* The host asks again, and is told again. */
        ++m->counters.acks_lost;
    }
}

/* A command in a frame that can be trusted: once, in order. */
TENDON_SMALL static void obey(
    tendon_machine *m,
    uint32_t type,
    uint32_t sequence,
    const uint8_t *payload,
    uint32_t length)
{
    const uint32_t expected = (m->sequence + 1U) & 0xffffU;
    const bool anew = (type == TENDON_COMMAND_STOP) || ((type == TENDON_COMMAND_HELLO) && !tendon_is_powered(m));
    uint32_t detail = 0U;
    if ((type == TENDON_COMMAND_STOP) && (m->state == TENDON_STATE_STOPPED) && (sequence == m->stopper)) {
        const tendon_ack_message answer = {(uint8_t)type, (uint8_t)TENDON_RESULT_DONE, (uint16_t)sequence, 0U};
        ++m->counters.duplicates;
        acknowledge(m, &answer);
    } else if (anew || (sequence == expected)) {
        const uint32_t result = execute(m, type, payload, length, &detail);
        m->sequence = sequence;
        m->type = type;
        m->stopper = (type == TENDON_COMMAND_STOP) ? sequence : m->stopper;
        m->answer.type = (uint8_t)type;
        m->answer.result = (uint8_t)result;
        m->answer.sequence = (uint16_t)sequence;
        m->answer.detail = (uint16_t)detail;
        if (result == TENDON_RESULT_UNKNOWN) {
            ++m->counters.unknown;
        } else if (result != TENDON_RESULT_DONE) {
            ++m->counters.refused;
        } else {
            /* Done. */
        }
        acknowledge(m, &m->answer);
    } else if ((sequence == m->sequence) && (type == m->type)) {
        ++m->counters.duplicates;
        acknowledge(m, &m->answer);
    } else {
        const tendon_ack_message answer = {
            (uint8_t)type, (uint8_t)TENDON_RESULT_SEQUENCE, (uint16_t)sequence, (uint16_t)expected};
        ++m->counters.out_of_order;
        acknowledge(m, &answer);
        if (tendon_is_powered(m)) {
            ++m->disordered;
            if (m->disordered > m->safety.errors) {
                tendon_stop(m, TENDON_REASON_SEQUENCE, TENDON_NO_JOINT, 0U);
            }
        }
    }
}

/* A frame of the right stuffing. */
TENDON_SMALL static void read_frame(tendon_machine *m)
{
    const uint32_t count = m->decoder.count;
    if (count < (TENDON_HEADER + TENDON_CHECKSUM)) {
        corrupted(m, &m->counters.bad_frame);
    } else {
        const uint32_t body = count - TENDON_CHECKSUM;
        const uint32_t version = m->frame[TENDON_PLACE_HEADER_VERSION];
        const uint32_t type = m->frame[TENDON_PLACE_HEADER_TYPE];
        const uint32_t length = tendon_get_u16(&m->frame[TENDON_PLACE_HEADER_LENGTH]);
        if (tendon_crc32(0U, m->frame, body) != tendon_get_u32(&m->frame[body])) {
            corrupted(m, &m->counters.bad_crc);
        } else if ((TENDON_HEADER + length) != body) {
            corrupted(m, &m->counters.bad_header);
        } else if ((version != TENDON_PROTOCOL_VERSION) && (type != TENDON_COMMAND_HELLO)) {
            corrupted(m, &m->counters.bad_header);
        } else {
            tendon_be_patient(m);
            obey(m, type, tendon_get_u16(&m->frame[TENDON_PLACE_HEADER_SEQUENCE]), &m->frame[TENDON_HEADER], length);
        }
    }
}

void tendon_machine_receive(tendon_machine *m, const uint8_t *bytes, uint32_t count)
{
    tendon_settle(m);
    for (uint32_t k = 0U; k < count; ++k) {
        const tendon_frame_event event = tendon_decoder_put(&m->decoder, m->frame, TENDON_FRAME_BYTES, bytes[k]);
        if (event == TENDON_FRAME_WHOLE) {
            read_frame(m);
        } else if (event == TENDON_FRAME_BROKEN) {
            corrupted(m, &m->counters.bad_frame);
        } else {
            /* More is to come. */
        }
    }
}

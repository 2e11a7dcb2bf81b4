/* Part of Tendon; do not edit a copy. Settings and trajectories from the host. */
#include <stddef.h>

#include "tendon_machine_private.h"

TENDON_SMALL static uint32_t take_drive(tendon_machine *m, const uint8_t *payload, uint32_t *detail)
{
    tendon_drive_message drive;
    uint32_t result;
    tendon_unpack_drive(payload, &drive);
    result = tendon_lower_drive(&drive, detail);
    if (result == TENDON_RESULT_DONE) {
        m->config.rate = drive.rate;
        m->config.velocity_gain = drive.velocity_gain;
        for (uint32_t j = 0U; j < TENDON_JOINTS; ++j) {
            m->config.position_per_count[j] = drive.position_per_count[j];
            m->config.zero[j] = drive.zero[j];
            m->config.kp[j] = drive.kp[j];
            m->config.kd[j] = drive.kd[j];
            m->config.torque_limit[j] = drive.torque_limit[j];
        }
        tendon_controller_prepare(&m->config);
    }
    return result;
}

/* Which value of a setting is in contradiction to another one; TENDON_LONGEST_COMMAND if none is. */
TENDON_SMALL static uint32_t contradiction(const tendon_safety_message *safety)
{
    uint32_t place = (safety->late < safety->early) ? TENDON_PLACE_SAFETY_LATE : TENDON_LONGEST_COMMAND;
    for (uint32_t j = TENDON_JOINTS; j > 0U; --j) {
        if (safety->low[j - 1U] > safety->high[j - 1U]) {
            place = TENDON_PLACE_SAFETY_HIGH + (j - 1U);
        }
    }
    return place;
}

TENDON_SMALL static uint32_t take_safety(tendon_machine *m, const uint8_t *payload, uint32_t *detail)
{
    uint32_t result = TENDON_RESULT_OUT_OF_RANGE;
    tendon_safety_message safety;
    tendon_unpack_safety(payload, &safety);
    *detail = contradiction(&safety);
    if (*detail == TENDON_LONGEST_COMMAND) {
        tendon_lower_safety(&safety, detail);
        result = TENDON_RESULT_DONE;
        m->safety = safety;
        m->margin = safety.late - safety.early;
        for (uint32_t j = 0U; j < TENDON_JOINTS; ++j) {
            tendon_bounds *b = &m->bounds[j];
            b->jump = (uint32_t)safety.jump[j];
            b->tracking = tendon_magnitude(safety.tracking[j]);
            b->speed = tendon_magnitude(safety.speed[j]);
            b->frozen = tendon_magnitude(safety.frozen[j]);
        }
    }
    return result;
}

uint32_t tendon_take_setting(tendon_machine *m, uint32_t type, const uint8_t *payload, uint32_t *detail)
{
    uint32_t result = TENDON_RESULT_DONE;
    uint32_t given = 0U;
    if (type == TENDON_COMMAND_PARAMETERS) {
        tendon_unpack_parameters(payload, &m->config.parameters);
        given = TENDON_MISSING_PARAMETERS;
    } else if (type == TENDON_COMMAND_EFFECTS) {
        tendon_unpack_effects(payload, &m->config.effects);
        given = TENDON_MISSING_EFFECTS;
    } else if (type == TENDON_COMMAND_DRIVE) {
        result = take_drive(m, payload, detail);
        given = TENDON_MISSING_DRIVE;
    } else {
        result = take_safety(m, payload, detail);
        given = TENDON_MISSING_SAFETY;
    }
    if (result == TENDON_RESULT_DONE) {
        m->missing &= ~given;
    }
    return result;
}

TENDON_SMALL static uint32_t take_trajectory(tendon_machine *m, const uint8_t *payload, uint32_t *detail)
{
    uint32_t result = TENDON_RESULT_OUT_OF_RANGE;
    tendon_trajectory_message message;
    tendon_unpack_trajectory(payload, &message);
    if (message.elbow == 0) {
        *detail = TENDON_PLACE_TRAJECTORY_ELBOW;
    } else {
        result = TENDON_RESULT_DONE;
        m->trajectory.count = message.count;
        m->trajectory.periodic = message.periodic;
        m->trajectory.elbow = (float)message.elbow;
        m->trajectory.phases = m->phases;
        tendon_take_springs(&message, m->trajectory.springs);
        tendon_take_contact(&message, &m->contact);
        m->missing |= TENDON_MISSING_TRAJECTORY;
        m->upload.open = 1U;
        m->upload.phases = 0U;
        m->upload.rows = 0U;
        m->upload.expected = message.rows;
        m->upload.checksum = 0U;
    }
    return result;
}

TENDON_SMALL static uint32_t take_phase(tendon_machine *m, const uint8_t *payload, uint32_t *detail)
{
    uint32_t result = TENDON_RESULT_DONE;
    tendon_phase_message message;
    tendon_unpack_phase(payload, &message);
    if ((m->upload.open == 0U) || (m->upload.phases >= m->trajectory.count) || (message.index != m->upload.phases)) {
        result = TENDON_RESULT_ORDER;
        *detail = m->upload.phases;
    } else if ((message.first_row + message.degree) >= m->upload.expected) {
        result = TENDON_RESULT_OUT_OF_RANGE;
        *detail = TENDON_PLACE_PHASE_FIRST_ROW;
    } else {
        tendon_phase *phase = &m->phases[message.index];
        phase->coordinates = message.coordinates;
        phase->degree = message.degree;
        phase->duration = message.duration;
        phase->points = &m->points[TENDON_JOINTS * message.first_row];
        phase->contact = (message.touches != 0U) ? &m->contact : NULL;
        tendon_controller_prepare_phase(phase);
        ++m->upload.phases;
    }
    return result;
}

TENDON_SMALL static uint32_t take_points(tendon_machine *m, const uint8_t *payload, uint32_t *detail)
{
    uint32_t result = TENDON_RESULT_DONE;
    tendon_points_message message;
    tendon_unpack_points(payload, &message);
    if ((m->upload.open == 0U) || (m->upload.rows >= m->upload.expected) || (message.first_row != m->upload.rows)) {
        result = TENDON_RESULT_ORDER;
        *detail = m->upload.rows;
    } else {
        for (uint32_t k = 0U; (k < TENDON_ROWS_A_MESSAGE) && (m->upload.rows < m->upload.expected); ++k) {
            for (uint32_t j = 0U; j < TENDON_JOINTS; ++j) {
                m->points[(TENDON_JOINTS * m->upload.rows) + j] = message.values[(TENDON_JOINTS * k) + j];
            }
            ++m->upload.rows;
        }
    }
    return result;
}

uint32_t tendon_take_part(
    tendon_machine *m,
    uint32_t type,
    const uint8_t *payload,
    uint32_t length,
    uint32_t *detail)
{
    uint32_t result;
    if (type == TENDON_COMMAND_TRAJECTORY) {
        result = take_trajectory(m, payload, detail);
    } else if (type == TENDON_COMMAND_PHASE) {
        result = take_phase(m, payload, detail);
    } else {
        result = take_points(m, payload, detail);
    }
    if (result == TENDON_RESULT_DONE) {
        m->upload.checksum = tendon_crc32(m->upload.checksum, payload, length);
    }
    return result;
}

uint32_t tendon_obey_commit(tendon_machine *m, const uint8_t *payload, uint32_t *detail)
{
    uint32_t result = TENDON_RESULT_DONE;
    tendon_commit_message message;
    tendon_unpack_commit(payload, &message);
    if ((m->upload.open == 0U) || (m->upload.phases != m->trajectory.count) || (m->upload.rows != m->upload.expected)) {
        result = TENDON_RESULT_INCOMPLETE;
        *detail = TENDON_MISSING_TRAJECTORY;
    } else if (message.checksum != m->upload.checksum) {
        result = TENDON_RESULT_CHECKSUM;
    } else {
        m->upload.open = 0U;
        m->missing &= ~TENDON_MISSING_TRAJECTORY;
    }
    return result;
}

/* Part of Tendon; do not edit a copy. Settings and trajectories from the host. */
#include <stddef.h>

#include "tendon_machine_private.h"

TENDON_SMALL static uint32_t take_drive(tendon_config *config, const uint8_t *payload, uint32_t *detail)
{
    tendon_drive_message drive;
    uint32_t result;
    tendon_unpack_drive(payload, &drive);
    result = tendon_lower_drive(&drive, detail);
    if (result == TENDON_RESULT_DONE) {
        config->rate = drive.rate;
        config->velocity_gain = drive.velocity_gain;
        for (uint32_t j = 0U; j < TENDON_JOINTS; ++j) {
            config->position_per_count[j] = drive.position_per_count[j];
            config->zero[j] = drive.zero[j];
            config->kp[j] = drive.kp[j];
            config->kd[j] = drive.kd[j];
            config->torque_limit[j] = drive.torque_limit[j];
        }
        tendon_controller_prepare(config);
    }
    return result;
}

/* The place of a value that contradicts another one; TENDON_LONGEST_COMMAND if there is none. */
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

TENDON_SMALL static uint32_t take_safety(tendon_machine_config *config, const uint8_t *payload, uint32_t *detail)
{
    uint32_t result = TENDON_RESULT_OUT_OF_RANGE;
    tendon_safety_message safety;
    tendon_unpack_safety(payload, &safety);
    *detail = contradiction(&safety);
    if (*detail == TENDON_LONGEST_COMMAND) {
        tendon_lower_safety(&safety, detail);
        result = TENDON_RESULT_DONE;
        config->safety = safety;
        config->step_window_us = safety.late - safety.early;
        for (uint32_t j = 0U; j < TENDON_JOINTS; ++j) {
            tendon_joint_limits *limits = &config->limits[j];
            limits->jump_counts = (uint32_t)safety.jump[j];
            limits->tracking_magnitude = tendon_magnitude(safety.tracking[j]);
            limits->speed_magnitude = tendon_magnitude(safety.speed[j]);
            limits->frozen_magnitude = tendon_magnitude(safety.frozen[j]);
        }
    }
    return result;
}

uint32_t tendon_take_setting(tendon_machine *m, uint32_t type, const uint8_t *payload, uint32_t *detail)
{
    uint32_t result = TENDON_RESULT_DONE;
    uint32_t given = 0U;
    if (type == TENDON_COMMAND_PARAMETERS) {
        tendon_unpack_parameters(payload, &m->config.controller.parameters);
        given = TENDON_MISSING_PARAMETERS;
    } else if (type == TENDON_COMMAND_EFFECTS) {
        tendon_unpack_effects(payload, &m->config.controller.effects);
        given = TENDON_MISSING_EFFECTS;
    } else if (type == TENDON_COMMAND_DRIVE) {
        result = take_drive(&m->config.controller, payload, detail);
        given = TENDON_MISSING_DRIVE;
    } else {
        result = take_safety(&m->config, payload, detail);
        given = TENDON_MISSING_SAFETY;
    }
    if (result == TENDON_RESULT_DONE) {
        m->state.missing_uploads &= ~given;
    }
    return result;
}

TENDON_SMALL static uint32_t take_trajectory(tendon_machine *m, const uint8_t *payload, uint32_t *detail)
{
    uint32_t result = TENDON_RESULT_OUT_OF_RANGE;
    tendon_trajectory *trajectory = &m->config.trajectory;
    tendon_upload *upload = &m->state.upload;
    tendon_trajectory_message message;
    tendon_unpack_trajectory(payload, &message);
    if (message.elbow == 0) {
        *detail = TENDON_PLACE_TRAJECTORY_ELBOW;
    } else {
        result = TENDON_RESULT_DONE;
        trajectory->count = message.count;
        trajectory->periodic = message.periodic;
        trajectory->elbow = (float)message.elbow;
        trajectory->phases = m->config.phases;
        tendon_take_springs(&message, trajectory->springs);
        tendon_take_contact(&message, &m->config.contact);
        m->state.missing_uploads |= TENDON_MISSING_TRAJECTORY;
        upload->open = 1U;
        upload->phases = 0U;
        upload->rows = 0U;
        upload->expected_rows = message.rows;
        upload->checksum = 0U;
    }
    return result;
}

TENDON_SMALL static uint32_t take_phase(tendon_machine *m, const uint8_t *payload, uint32_t *detail)
{
    uint32_t result = TENDON_RESULT_DONE;
    tendon_upload *upload = &m->state.upload;
    tendon_phase_message message;
    tendon_unpack_phase(payload, &message);
    if ((upload->open == 0U) || (upload->phases >= m->config.trajectory.count)
        || (message.index != upload->phases)) {
        result = TENDON_RESULT_ORDER;
        *detail = upload->phases;
    } else if ((message.first_row + message.degree) >= upload->expected_rows) {
        result = TENDON_RESULT_OUT_OF_RANGE;
        *detail = TENDON_PLACE_PHASE_FIRST_ROW;
    } else {
        tendon_phase *phase = &m->config.phases[message.index];
        phase->coordinates = message.coordinates;
        phase->degree = message.degree;
        phase->duration = message.duration;
        phase->points = &m->config.points[TENDON_JOINTS * message.first_row];
        phase->contact = (message.touches != 0U) ? &m->config.contact : NULL;
        tendon_controller_prepare_phase(phase);
        ++upload->phases;
    }
    return result;
}

TENDON_SMALL static uint32_t take_points(tendon_machine *m, const uint8_t *payload, uint32_t *detail)
{
    uint32_t result = TENDON_RESULT_DONE;
    tendon_upload *upload = &m->state.upload;
    tendon_points_message message;
    tendon_unpack_points(payload, &message);
    if ((upload->open == 0U) || (upload->rows >= upload->expected_rows)
        || (message.first_row != upload->rows)) {
        result = TENDON_RESULT_ORDER;
        *detail = upload->rows;
    } else {
        for (uint32_t k = 0U; (k < TENDON_ROWS_A_MESSAGE) && (upload->rows < upload->expected_rows); ++k) {
            for (uint32_t j = 0U; j < TENDON_JOINTS; ++j) {
                m->config.points[(TENDON_JOINTS * upload->rows) + j] = message.values[(TENDON_JOINTS * k) + j];
            }
            ++upload->rows;
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
        m->state.upload.checksum = tendon_crc32(m->state.upload.checksum, payload, length);
    }
    return result;
}

uint32_t tendon_command_commit(tendon_machine *m, const uint8_t *payload, uint32_t *detail)
{
    uint32_t result = TENDON_RESULT_DONE;
    tendon_upload *upload = &m->state.upload;
    tendon_commit_message message;
    tendon_unpack_commit(payload, &message);
    if ((upload->open == 0U) || (upload->phases != m->config.trajectory.count)
        || (upload->rows != upload->expected_rows)) {
        result = TENDON_RESULT_INCOMPLETE;
        *detail = TENDON_MISSING_TRAJECTORY;
    } else if (message.checksum != upload->checksum) {
        result = TENDON_RESULT_CHECKSUM;
    } else {
        upload->open = 0U;
        m->state.missing_uploads &= ~TENDON_MISSING_TRAJECTORY;
    }
    return result;
}

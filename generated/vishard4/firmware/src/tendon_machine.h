/* Part of Tendon; do not edit a copy. The machine. */
#ifndef TENDON_MACHINE_H
#define TENDON_MACHINE_H

#include <stdbool.h>
#include <stdint.h>

#include "tendon_arm.h"
#include "tendon_controller.h"
#include "tendon_frame.h"
#include "tendon_messages.h"

/* The machine drives the arm: uploads from the host, modes, the controller's step with its guard, telemetry.
 * The caller owns the memory and calls the functions one after another, never from within one another. Nothing is
 * allocated, there is no other state, and every loop has a bound.
 * PROTOCOL.md describes the protocol, the modes and the reasons for a stop.
 *
 * Modes (TENDON_STATE_...):
 *   IDLE      The drives are off. Only this mode accepts settings and trajectories. `arm` leads to ARMED.
 *   ARMED     The drives are on, all torques are zero, and the guard watches the link, the clock, the drives and the
 *             encoders. `run` leads to RUNNING.
 *   RUNNING   The controller follows the trajectory. The end of the run, the host or the guard leads to STOPPED.
 *   STOPPED   Torques damp the motion for `safety.damping` periods. They are zero at once if the reason for the stop
 *             says that measurements or drives cannot be trusted. Then the drives go off, and `reset` leads to IDLE.
 */

/* Bytes of the longest frames: a command before COBS encoding, a report before and after it. */
#define TENDON_FRAME_BYTES (TENDON_HEADER + TENDON_LONGEST_COMMAND + TENDON_CHECKSUM)
#define TENDON_PLAIN_BYTES (TENDON_HEADER + TENDON_LONGEST_REPORT + TENDON_CHECKSUM)
#define TENDON_WIRE_BYTES (TENDON_PLAIN_BYTES + (TENDON_PLAIN_BYTES / 254U) + 2U)

/* Limits of a joint, from `safety` and `drive`. A magnitude is a float's absolute value as an integer that compares as
 * the float does (tendon_magnitude); NaN and infinity are above all others. */
typedef struct {
    uint32_t jump_counts; /* largest movement in a period */
    uint32_t lowest_count; /* lower end of the range of position */
    uint32_t range_counts; /* width of that range */
    uint32_t tracking_magnitude; /* rad or m: largest error of position */
    uint32_t speed_magnitude; /* rad/s or m/s: largest filtered speed */
    uint32_t frozen_magnitude; /* rad or m: largest desired motion without a change of the count */
} tendon_joint_limits;

/* What the guard remembers of a joint. */
typedef struct {
    int32_t last_count; /* encoder count when the joint was last inspected */
    float q_desired_at_change; /* rad or m: desired position when that count was first seen */
    uint32_t damping_speed_magnitude; /* rad/s or m/s: a higher speed ends the damping */
} tendon_joint_watch;

/* Telemetry of a control period; the controller writes its output directly into it. */
typedef struct {
    tendon_output output;
    int32_t counts[TENDON_JOINTS];
    uint32_t period;
    uint32_t time_us;
    uint32_t mode_and_reason; /* the mode, and the number of the reason times 256 */
} tendon_record;

/* Progress of the upload of a trajectory. */
typedef struct {
    uint32_t open; /* 1: begun and not yet committed */
    uint32_t phases; /* received */
    uint32_t rows; /* received */
    uint32_t expected_rows;
    uint32_t checksum; /* CRC-32 of the payloads received */
} tendon_upload;

/* What the host configures in IDLE, and what follows from it. */
typedef struct {
    tendon_config controller;
    tendon_safety_message safety; /* within the ceilings */
    uint32_t step_window_us; /* longest minus shortest time between two steps */
    tendon_joint_limits limits[TENDON_JOINTS];
    tendon_trajectory trajectory;
    tendon_contact contact;
    tendon_phase phases[TENDON_MAX_PHASES];
    float points[TENDON_JOINTS * TENDON_MAX_ROWS];
} tendon_machine_config;

/* What the control step and the commands change. Periods that end in TENDON_ENDLESS never pass. */
typedef struct {
    uint32_t following; /* 1: RUNNING, after the first step of the run */
    uint32_t step_time_us; /* board's clock at the last step */
    uint32_t period; /* control periods since `run` */
    uint32_t end_period; /* period at which the run ends */
    uint32_t until_check_periods; /* until the run ends or the host has been silent for too long */
    uint32_t saturated_left_periods; /* further periods in a row whose torque may be limited; wraps below 0 */
    uint32_t until_record_periods; /* until the next telemetry record; 0: the last step's is not yet queued */
    uint32_t resume_record_periods; /* nonzero: from a record that `query` inserted to the next regular one */
    uint32_t every_record_periods; /* from one regular record to the next */
    tendon_record *record; /* the present step's */
    tendon_record *last_record; /* the last step's; the same one unless that was queued for the link */
    uint32_t inspected_joint; /* last joint that was inspected, from 0 */
    uint32_t mode;
    uint32_t awaits_first_step; /* 1: no step since `arm` */
    uint32_t damped_untimely; /* 1: the last step of the damping was untimely */
    uint32_t drives_not_ready; /* 1: the drives were not ready at the last step */
    uint32_t damping_left_periods;
    uint32_t drives_enabled;
    tendon_controller_state controller;
    tendon_statistics statistics;
    tendon_joint_watch watch[TENDON_JOINTS];
    uint32_t missing_uploads; /* bits TENDON_MISSING_... */
    tendon_upload upload;
    tendon_state_message report; /* why the arm is stopped */
} tendon_machine_state;

/* The link to the host. Queues hold entries from tail to head. */
typedef struct {
    tendon_decoder decoder;
    uint32_t sequence; /* of the last command */
    uint32_t type; /* of the last command */
    uint32_t stop_sequence; /* of the last `stop` since the arm stopped, or TENDON_NO_STOP */
    tendon_ack_message answer; /* to the last command */
    uint32_t corrupted_frames; /* since `arm` */
    uint32_t disordered_commands; /* since `arm` */
    tendon_counters_message counters;
    uint32_t pending_reports; /* bits TENDON_PENDING_... */
    uint32_t sent_telemetry; /* 1: the last report was telemetry */
    uint32_t ack_head; /* where the next acknowledgement goes */
    uint32_t ack_tail; /* which acknowledgement is sent next */
    uint32_t record_tail; /* which record is sent next */
    uint32_t free_records; /* besides that of the present period */
    uint32_t report_sequence; /* of the next report */
    uint32_t wire_bytes; /* of the report in `wire` */
    uint32_t wire_sent_bytes; /* how many of those were sent */
    tendon_ack_message acks[TENDON_ACKS];
    tendon_record records[TENDON_TELEMETRY_RECORDS + 1U];
    uint8_t frame[TENDON_FRAME_BYTES];
    uint8_t wire[TENDON_WIRE_BYTES];
} tendon_link;

/* The machine. Its members are private, and it must not be moved once started, as it points into itself. */
typedef struct {
    tendon_machine_state state;
    tendon_machine_config config;
    tendon_link link;
} tendon_machine;

/* Bytes of the structure. */
TENDON_SMALL uint32_t tendon_machine_size(void);

/* Enters IDLE with nothing uploaded. */
TENDON_SMALL void tendon_machine_start(tendon_machine *m);

/* Takes bytes from the link, in pieces of any length. */
TENDON_SMALL void tendon_machine_receive(tendon_machine *m, const uint8_t *bytes, uint32_t count);

/* One control period: encoders in, torques out, to be held until the next step.
 * counts    of the encoders; they may overflow
 * time_us   the board's clock, which wraps at 2^32; the watchdog uses it
 * fault     0, the code of a fault that a drive reports, or TENDON_NOT_READY
 * torque    N m at a revolute joint, N at a prismatic one; zero whenever the drives are off */
void tendon_machine_step(
    tendon_machine *m,
    const int32_t counts[TENDON_JOINTS],
    uint32_t time_us,
    uint32_t fault,
    float torque[TENDON_JOINTS]);

/* Whether the drives must be on; to be asked after every step. */
bool tendon_machine_enabled(const tendon_machine *m);

/* Writes up to `most` bytes that are to be sent on the link, and returns how many. */
TENDON_SMALL uint32_t tendon_machine_send(tendon_machine *m, uint8_t *bytes, uint32_t most);

#endif

/* Part of Tendon; do not edit a copy. The machine. */
#ifndef TENDON_MACHINE_H
#define TENDON_MACHINE_H

#include <stdbool.h>
#include <stdint.h>

#include "tendon_arm.h"
#include "tendon_controller.h"
#include "tendon_frame.h"
#include "tendon_messages.h"

/* All that drives the arm: what the host uploads, the states, the controller's step with a guard around it, telemetry.
 * The caller owns the memory and calls the functions one after another, never one within another. Nothing is
 * allocated, nothing is kept elsewhere, every loop has a bound.
 * The protocol, the states and what stops the arm are described in PROTOCOL.md. */

/* Bytes of the longest frames: of a command before the stuffing, of a report after it. */
#define TENDON_FRAME_BYTES (TENDON_HEADER + TENDON_LONGEST_COMMAND + TENDON_CHECKSUM)
#define TENDON_PLAIN_BYTES (TENDON_HEADER + TENDON_LONGEST_REPORT + TENDON_CHECKSUM)
#define TENDON_WIRE_BYTES (TENDON_PLAIN_BYTES + (TENDON_PLAIN_BYTES / 254U) + 2U)

/* What a joint must keep to. Magnitudes of floats as whole numbers, which compare as the floats do: twice their bits.
 * What is no number or has no end is larger than all. */
typedef struct {
    uint32_t jump; /* counts in a period */
    uint32_t lowest; /* count */
    uint32_t range; /* counts from there on */
    uint32_t tracking; /* magnitude */
    uint32_t speed; /* magnitude */
    uint32_t frozen; /* magnitude */
    uint32_t outrun; /* magnitude, of the rate in the damping */
    int32_t seen; /* the encoder's count when it was last looked for a change */
    float mark; /* where the joint should have been then */
} tendon_bounds;

/* A control period, as telemetry tells of it; the controller writes its output right into it. */
typedef struct {
    tendon_output output;
    int32_t counts[TENDON_JOINTS];
    uint32_t period;
    uint32_t time_us;
    uint32_t standing; /* state, and the reason's number times 256 */
} tendon_record;

/* A trajectory while it is uploaded. */
typedef struct {
    uint32_t open; /* 1: begun and not yet committed */
    uint32_t phases; /* received */
    uint32_t rows; /* received */
    uint32_t expected; /* rows */
    uint32_t checksum; /* of what was received */
} tendon_upload;

/* The machine: its members are its own. It may not be moved once it has been started. */
typedef struct {
    /* the control step */
    uint32_t steady; /* 1: running, and not the first step */
    uint32_t time_us; /* of the last step */
    uint32_t margin; /* us, from the shortest period to the longest */
    uint32_t period;
    uint32_t last; /* period in which the run is over */
    uint32_t left; /* periods until the run is over or the host has been silent for too long */
    uint32_t tolerance; /* periods with a limited torque that are left; the largest number: none were */
    uint32_t until; /* periods until the next telemetry record; 0: that of the last step is still to be made */
    uint32_t resume; /* not 0: periods from the next record, which was asked for, to the one after it */
    uint32_t every; /* periods from one record to the next */
    uint32_t room; /* for records, besides that of the present period */
    tendon_record *now; /* into which a step writes */
    tendon_record *before; /* into which the last one wrote: the same one, unless that is for the link */
    uint32_t looked; /* which joint was looked at closely, from 0 */
    uint32_t state;
    uint32_t first; /* 1: no step since arm */
    uint32_t untimely; /* 1: so was the last step of the damping */
    uint32_t unready; /* 1: so were the drives in the last step */
    uint32_t damping; /* periods that are left */
    uint32_t enabled;
    tendon_controller_state controller;
    tendon_bounds bounds[TENDON_JOINTS];
    /* what was uploaded */
    tendon_config config;
    tendon_safety_message safety;
    tendon_trajectory trajectory;
    tendon_contact contact;
    tendon_phase phases[TENDON_MAX_PHASES];
    float points[TENDON_JOINTS * TENDON_MAX_ROWS];
    tendon_upload upload;
    uint32_t missing; /* bits */
    /* why it is stopped */
    tendon_state_message report;
    /* the link */
    tendon_decoder decoder;
    uint32_t sequence; /* of the last command */
    uint32_t type; /* of the last command */
    uint32_t stopper; /* number of the last `stop` since the arm stopped, if there was one */
    tendon_ack_message answer; /* to the last command */
    uint32_t corrupted; /* frames since arm */
    uint32_t disordered; /* commands since arm */
    tendon_counters_message counters;
    uint32_t pending; /* bits of the reports that are to be sent */
    uint32_t turn; /* 1: telemetry was sent last */
    uint32_t ack_head; /* where the next one goes */
    uint32_t ack_tail; /* which one is sent next */
    uint32_t record_tail; /* which one is sent next */
    uint32_t sent_frames;
    uint32_t ready; /* bytes of `wire` */
    uint32_t sent; /* of them */
    tendon_ack_message acks[TENDON_ACKS];
    tendon_record records[TENDON_TELEMETRY_RECORDS + 1U];
    uint8_t frame[TENDON_FRAME_BYTES];
    uint8_t wire[TENDON_WIRE_BYTES];
} tendon_machine;

/* Bytes of the structure. */
TENDON_SMALL uint32_t tendon_machine_size(void);

/* Idle, with nothing uploaded. */
TENDON_SMALL void tendon_machine_start(tendon_machine *m);

/* What came over the link, in pieces of any length. */
TENDON_SMALL void tendon_machine_receive(tendon_machine *m, const uint8_t *bytes, uint32_t count);

/* A control period begins: encoders in, torques out, to be held until the next step.
 * counts    of the encoders; they may overflow
 * time_us   of the board's clock, us; wraps. The watchdog goes by it
 * fault     0, or the code of a fault that a drive reports, or TENDON_NOT_READY
 * torque    N m at a revolute joint, N at a prismatic one; zero wherever the drives are off */
void tendon_machine_step(
    tendon_machine *m,
    const int32_t counts[TENDON_JOINTS],
    uint32_t time_us,
    uint32_t fault,
    float torque[TENDON_JOINTS]);

/* Whether the drives have to be on; ask after every step. */
bool tendon_machine_enabled(const tendon_machine *m);

/* Writes what is to go out on the link now, `most` bytes at most, and returns how many. */
TENDON_SMALL uint32_t tendon_machine_send(tendon_machine *m, uint8_t *bytes, uint32_t most);

#endif

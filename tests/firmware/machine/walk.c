/* Every state of the machine of a one-jointed arm, from its start on, and from each of them every event: all commands,
 * noise, and control steps with every kind of time, fault, encoder, rate, and outcome of the controller. The machine is
 * the firmware's; its controller is one that does whatever a controller may do, at the walk's will. Two states are the
 * same where all is that decides what the machine does next; counts of frames and the like are left out.
 * What must hold is in `check`. Prints what was walked. */
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tendon_board.h"
#include "tendon_machine_private.h"

#define MOST_STATES (1U << 17)
#define SLOTS (1U << 19)
#define PERIOD 1000U
#define COUNT(array) (sizeof(array) / sizeof((array)[0]))

static tendon_machine machine; /* where it stands, for it points into itself */
static uint32_t stops; /* bits: reasons that were met */

/* ---- the controller ---- */

static const float rates[] = {0.0f, 1e-40f, -1.0f, 50.0f, -3e38f, NAN};
static const struct {
    float part; /* of the torque's limit */
    float desired;
    uint32_t status;
} outcomes[] = {
    {0.0f, 0.0f, 0U}, {0.5f, 0.4f, 0U}, {1.0f, 0.0f, TENDON_STATUS_SATURATED}, {-1.0f, 0.0f, TENDON_STATUS_FINISHED},
    {-0.25f, 9.0f, 0U}, {0.0f, NAN, TENDON_STATUS_INVALID},
};
static size_t rate;
static size_t outcome;

void CONTROLLER(prepare)(tendon_config *config)
{
    (void)config;
}

void CONTROLLER(prepare_phase)(tendon_phase *phase)
{
    (void)phase;
}

void CONTROLLER(reset)(tendon_controller_state *state, const int32_t counts[TENDON_JOINTS])
{
    state->counts[0] = counts[0];
    state->q[0] = 0.0f;
    state->qd[0] = 0.0f;
}

void CONTROLLER(measure)(const tendon_config *config, tendon_controller_state *state, const int32_t counts[TENDON_JOINTS])
{
    (void)config;
    state->counts[0] = counts[0];
    state->qd[0] = rates[rate];
}

void CONTROLLER(step)(
    const tendon_config *config,
    const tendon_trajectory *trajectory,
    tendon_controller_state *state,
    const int32_t counts[TENDON_JOINTS],
    tendon_output *output)
{
    (void)trajectory;
    CONTROLLER(measure)(config, state, counts);
    output->torque[0] = outcomes[outcome].part * config->torque_limit[0];
    output->q_desired[0] = outcomes[outcome].desired;
    output->phase = 0U;
    output->status = outcomes[outcome].status;
}

/* ---- the host ---- */

static uint8_t payload[TENDON_LONGEST_COMMAND];

static void drain(void)
{
    uint8_t out[256];
    while (tendon_machine_send(&machine, out, sizeof out) != 0U) {
    }
}

static void say(uint32_t type, uint32_t size, uint32_t ahead)
{
    static uint8_t plain[TENDON_FRAME_BYTES];
    static uint8_t wire[TENDON_FRAME_BYTES + 8U];
    tendon_put_u8(&plain[0], TENDON_PROTOCOL_VERSION);
    tendon_put_u8(&plain[1], type);
    tendon_put_u16(&plain[2], (machine.link.sequence + ahead) & 0xffffU);
    tendon_put_u16(&plain[4], size);
    memcpy(&plain[6], payload, size);
    tendon_put_u32(&plain[6U + size], tendon_crc32(0U, plain, 6U + size));
    tendon_machine_receive(&machine, wire, tendon_cobs_encode(plain, size + 10U, wire));
    drain();
}

static void fill(uint32_t size, float value)
{
    for (uint32_t k = 0U; k < size; k += 4U) {
        tendon_put_float(&payload[k], value);
    }
}

/* wide: as far up as a message can say it. */
static void say_drive(bool wide)
{
    fill(28U, 0.5f);
    tendon_put_float(&payload[0], 1000.0f);
    tendon_put_i32(&payload[12], 0);
    tendon_put_float(&payload[16], wide ? 1e9f : 20.0f);
    tendon_put_float(&payload[20], wide ? 1e9f : 3.0f);
    tendon_put_float(&payload[24], wide ? 3e38f : 5.0f);
    say(TENDON_COMMAND_DRIVE, 28U, 1U);
}

static void say_safety(bool wide, uint32_t damping)
{
    fill(52U, wide ? 3e38f : 2.0f);
    tendon_put_float(&payload[8], wide ? -3e38f : -2.0f);
    tendon_put_i32(&payload[20], 100);
    tendon_put_float(&payload[24], wide ? 3e38f : 0.3f); /* frozen */
    tendon_put_u32(&payload[28], 1U); /* saturated */
    tendon_put_u32(&payload[32], 2U); /* silence */
    tendon_put_u32(&payload[36], 1U); /* errors */
    tendon_put_u32(&payload[40], PERIOD / 2U);
    tendon_put_u32(&payload[44], 2U * PERIOD);
    tendon_put_u32(&payload[48], damping);
    say(TENDON_COMMAND_SAFETY, 52U, 1U);
}

/* The parts of a trajectory, from the first one on. */
static void upload(uint32_t parts)
{
    uint32_t checksum = 0U;
    const uint32_t size = SIZE_TRAJECTORY;
    memset(payload, 0, sizeof payload);
    tendon_put_u32(&payload[0], 1U);
    tendon_put_i32(&payload[8], 1);
    tendon_put_u32(&payload[12], 5U);
    checksum = tendon_crc32(checksum, payload, size);
    say(TENDON_COMMAND_TRAJECTORY, size, 1U);
    if (parts > 1U) {
        memset(payload, 0, sizeof payload);
        tendon_put_u32(&payload[8], 4U);
        tendon_put_float(&payload[12], 1.0f);
        checksum = tendon_crc32(checksum, payload, 24U);
        say(TENDON_COMMAND_PHASE, 24U, 1U);
        memset(payload, 0, sizeof payload);
        checksum = tendon_crc32(checksum, payload, 4U + (4U * TENDON_ROWS_A_MESSAGE));
        say(TENDON_COMMAND_POINTS, 4U + (4U * TENDON_ROWS_A_MESSAGE), 1U);
        tendon_put_u32(payload, checksum);
        say(TENDON_COMMAND_COMMIT, 4U, 1U);
    }
}

static void run(uint32_t periods)
{
    tendon_put_u32(&payload[0], periods);
    tendon_put_u32(&payload[4], 1U);
    say(TENDON_COMMAND_RUN, 8U, 1U);
}

static void noise(void)
{
    static const uint8_t bytes[] = {9U, 7U, 0U};
    tendon_machine_receive(&machine, bytes, sizeof bytes);
    drain();
}

#define WORDS 22U

static void command(uint32_t which)
{
    switch (which) {
    case 0U: fill(SIZE_PARAMETERS, 0.5f); say(TENDON_COMMAND_PARAMETERS, SIZE_PARAMETERS, 1U); break;
    case 1U: fill(SIZE_EFFECTS, 0.5f); say(TENDON_COMMAND_EFFECTS, SIZE_EFFECTS, 1U); break;
    case 2U: say_drive(false); break;
    case 3U: say_drive(true); break;
    case 4U: say_safety(false, 2U); break;
    case 5U: say_safety(true, 0U); break;
    case 6U: upload(1U); break;
    case 7U: upload(4U); break;
    case 8U: say(TENDON_COMMAND_ARM, 0U, 1U); break;
    case 9U: run(0U); break;
    case 10U: run(1U); break;
    case 11U: run(2U); break;
    case 12U: say(TENDON_COMMAND_ALIVE, 0U, 1U); break;
    case 13U: say(TENDON_COMMAND_STOP, 0U, 1U); break;
    case 14U: say(TENDON_COMMAND_STOP, 0U, 0U); break;
    case 15U: say(TENDON_COMMAND_RESET, 0U, 1U); break;
    case 16U: say(TENDON_COMMAND_QUERY, 0U, 1U); break;
    case 17U: say(TENDON_COMMAND_HELLO, 0U, 1U); break;
    case 18U: say(TENDON_COMMAND_HELLO, 0U, 9U); break;
    case 19U: say(TENDON_COMMAND_ALIVE, 0U, 9U); break;
    case 20U: say(99U, 0U, 1U); break;
    default: noise(); break;
    }
}

/* ---- the states ---- */

/* All that decides what the machine does next: of what is set anew before it is read, nothing. */
typedef struct {
    uint32_t words[20];
} key;

static uint32_t bits_of(float x)
{
    tendon_word w;
    w.value = x;
    return w.bits;
}

static uint32_t if_so(bool so, uint32_t word)
{
    return so ? word : 0U;
}

static key key_of(void)
{
    const tendon_machine *m = &machine;
    const tendon_machine_state *s = &m->state;
    const tendon_link *l = &m->link;
    const tendon_config *c = &m->config.controller;
    const bool idle = s->mode == TENDON_STATE_IDLE;
    const bool running = s->mode == TENDON_STATE_RUNNING;
    const bool damped = (s->mode == TENDON_STATE_STOPPED) && (s->damping_left_periods != 0U);
    const bool powered = (s->mode == TENDON_STATE_ARMED) || running;
    const uint32_t more = s->end_period - s->period;
    const key k = {{
        s->mode | (s->following << 2) | (s->awaits_first_step << 3)
            | (s->drives_not_ready << 4) | (s->drives_enabled << 5)
            | ((l->stop_sequence != TENDON_NO_STOP ? 1U : 0U) << 6) | ((l->stop_sequence == l->sequence ? 1U : 0U) << 7)
            | (if_so(damped, s->damped_untimely) << 8) | (s->upload.open << 9)
            | ((l->type == TENDON_COMMAND_STOP ? 1U : 0U)
            << 10),
        s->missing_uploads, bits_of(c->torque_limit[0]), bits_of(c->kd[0]),
        m->config.safety.damping,
        m->config.limits[0].speed_magnitude, s->damping_left_periods, s->report.reason,
        if_so(powered, s->until_check_periods), if_so(powered, l->corrupted_frames),
        if_so(powered, l->disordered_commands),
        if_so(running, s->saturated_left_periods), if_so(running, (s->end_period == TENDON_ENDLESS) ? 9U : more),
        if_so(running, bits_of(s->watch[0].q_desired_at_change)), if_so(damped || powered, bits_of(s->controller.qd[0])),
        if_so(damped, s->watch[0].damping_speed_magnitude), if_so(idle, s->upload.phases), if_so(idle, s->upload.rows), 0U, 0U}};
    return k;
}

static tendon_machine *states;
static key *keys;
static uint32_t slots[SLOTS];
static uint32_t found;

/* Notes the state in which the machine is, if it is a new one. */
static void visit(void)
{
    const key k = key_of();
    uint32_t hash = tendon_crc32(0U, (const uint8_t *)&k, sizeof k) % SLOTS;
    while ((slots[hash] != 0U) && (memcmp(&keys[slots[hash] - 1U], &k, sizeof k) != 0)) {
        hash = (hash + 1U) % SLOTS;
    }
    if (slots[hash] == 0U) {
        if (found == MOST_STATES) {
            puts("more states than there is room for");
            exit(1);
        }
        states[found] = machine;
        keys[found] = k;
        ++found;
        slots[hash] = found;
    }
}

/* ---- what must hold ---- */

static void demand(bool holds, const char *what)
{
    if (!holds) {
        printf("%s: state %u, reason %u, rate %g, outcome %u\n", what, (unsigned)machine.state.mode,
            (unsigned)machine.state.report.reason, (double)rates[rate], (unsigned)outcome);
        exit(1);
    }
}

/* Of a state, by whatever event it was reached. */
static void check_state(void)
{
    const tendon_machine *m = &machine;
    const bool powered = (m->state.mode == TENDON_STATE_ARMED) || (m->state.mode == TENDON_STATE_RUNNING);
    demand(m->state.mode <= TENDON_STATE_STOPPED, "a state that there is none of");
    demand((m->state.mode == TENDON_STATE_STOPPED) == (m->state.report.reason != TENDON_REASON_NONE), "a stop without a reason");
    demand((m->state.drives_enabled == 1U) || !powered, "powered without drives");
    demand((m->state.drives_enabled == 0U) || (m->state.mode != TENDON_STATE_IDLE), "drives on in idle");
    demand(m->config.controller.torque_limit[0] <= TENDON_MOST_TORQUE, "a limit over the ceiling");
    demand((m->state.mode == TENDON_STATE_IDLE) || (m->state.missing_uploads == 0U), "more than idle without settings");
    demand(m->state.damping_left_periods <= m->config.safety.damping, "a damping that is longer than was asked for");
}

/* Of a step: before is how the machine stood. */
static void check_step(const tendon_machine *before, float torque)
{
    const tendon_machine *m = &machine;
    const float qd = m->state.controller.qd[0];
    const bool without = ((TENDON_REASONS_WITHOUT_TORQUE >> m->state.report.reason) & 1U) != 0U;
    check_state();
    demand(isfinite(torque), "a torque that is no finite number");
    demand(fabsf(torque) <= m->config.controller.torque_limit[0], "a torque over its limit");
    demand((torque == 0.0f) || tendon_machine_enabled(m), "a torque while the drives are off");
    demand((torque == 0.0f) || (m->state.mode >= TENDON_STATE_RUNNING), "a torque in idle or armed");
    if (m->state.mode == TENDON_STATE_STOPPED) {
        demand((torque == 0.0f) || ((qd != 0.0f) && (signbit(torque) != signbit(qd))), "a torque after a stop that does not damp");
        demand((torque == 0.0f) || (fabsf(torque) <= fabsf(m->config.controller.kd[0] * qd)), "more than damping after a stop");
        demand((torque == 0.0f) || !without, "a torque after a reason that leaves none");
        stops |= 1U << m->state.report.reason;
    }
    if (before->state.mode == TENDON_STATE_STOPPED) {
        demand(m->state.mode == TENDON_STATE_STOPPED, "a step out of a stop");
        const uint32_t left = before->state.damping_left_periods;
        const bool off = m->state.drives_enabled == 0U;
        demand((left == 0U) ? off : (m->state.damping_left_periods < left), "a damping without end");
        demand((before->state.drives_enabled == 1U) || (m->state.drives_enabled == 0U), "drives that come on after a stop");
    }
}

static void step(const tendon_machine *before, uint32_t us, uint32_t fault, int32_t travel)
{
    const int32_t counts = before->state.controller.counts[0] + travel;
    float torque = NAN;
    /* Nothing that stood there may be given: every step gives its own. */
    machine.state.record->output.torque[0] = NAN;
    machine.state.last_record->output.torque[0] = NAN;
    tendon_machine_step(&machine, &counts, before->state.step_time_us + us, fault, &torque);
    drain();
    check_step(before, torque);
    visit();
}

int main(void)
{
    static const uint32_t times[] = {PERIOD, 1U, 9U * PERIOD};
    static const uint32_t faults[] = {0U, TENDON_NOT_READY, 7U};
    static const int32_t travels[] = {0, 1, 5000};
    uint64_t steps = 0U;
    states = calloc(MOST_STATES, sizeof *states);
    keys = calloc(MOST_STATES, sizeof *keys);
    tendon_machine_start(&machine);
    drain();
    visit();
    for (uint32_t from = 0U; from < found; ++from) {
        for (uint32_t which = 0U; which < WORDS; ++which) {
            machine = states[from];
            command(which);
            check_state();
            visit();
        }
        for (size_t t = 0U; t < COUNT(times) * COUNT(faults) * COUNT(travels); ++t) {
            for (rate = 0U; rate < COUNT(rates); ++rate) {
                for (outcome = 0U; outcome < COUNT(outcomes); ++outcome) {
                    machine = states[from];
                    step(&states[from], times[t % 3U], faults[(t / 3U) % 3U], travels[t / 9U]);
                    ++steps;
                }
            }
        }
    }
    printf("states=%u commands=%u steps=%llu reasons=0x%x\n", (unsigned)found, (unsigned)(found * WORDS),
        (unsigned long long)steps, (unsigned)stops);
    return 0;
}

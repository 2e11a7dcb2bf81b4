/* The machine of a one-jointed arm under frames that are random, mutated or flipped. Compiled with and without
 * sanitizers; each job prints its figures on one line.
 *   frames COUNT SEED     random and mutated frames in pieces of any length, with control steps in between
 *   flips COUNT SEED      every single flipped bit of every message, then so many random pairs of them
 *   chance COUNT SEED     random frames of a message's length: how often the checksum fits by chance
 *   script SEED           regular runs through all states, with values at random */
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tendon_board.h"
#include "tendon_machine.h"

#define WIRE 512U
#define KINDS 20U

static tendon_machine machine;
static uint64_t seed;

static uint32_t chance(void)
{
    /* Splitmix64 (Steele, Lea & Flood 2014). */
    uint64_t z = (seed += 0x9e3779b97f4a7c15ULL);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
    return (uint32_t)((z ^ (z >> 31)) >> 16);
}

static uint32_t below(uint32_t end)
{
    return (uint32_t)(((uint64_t)chance() * end) >> 32);
}

static uint32_t rejected(void)
{
    const tendon_counters_message *c = &machine.link.counters;
    return c->bad_crc + c->bad_frame + c->bad_header;
}

/* What the payload of a message takes, as protocol.json says; given on the command line of the compiler. */
static const struct {
    uint8_t type;
    uint16_t size;
} kinds[KINDS] = {MESSAGES};

static uint32_t frame(uint32_t type, uint32_t sequence, const uint8_t *payload, uint32_t size, uint8_t *wire)
{
    uint8_t plain[WIRE];
    tendon_put_u8(&plain[0], TENDON_PROTOCOL_VERSION);
    tendon_put_u8(&plain[1], type);
    tendon_put_u16(&plain[2], sequence);
    tendon_put_u16(&plain[4], size);
    memcpy(&plain[6], payload, size);
    tendon_put_u32(&plain[6U + size], tendon_crc32(0U, plain, 6U + size));
    return tendon_cobs_encode(plain, size + 10U, wire);
}

/* Plausible or wild numbers. */
static void fill(uint8_t *payload, uint32_t size)
{
    for (uint32_t k = 0U; k < size; k += 4U) {
        uint8_t bytes[4];
        switch (below(6U)) {
        case 0U:
            tendon_put_u32(bytes, chance());
            break;
        case 1U:
            tendon_put_float(bytes, (float)below(2000U) * 0.001f);
            break;
        case 2U:
            tendon_put_u32(bytes, below(9U));
            break;
        case 3U:
            tendon_put_u32(bytes, below(2U) ? 0x7f800000U : 0x7fc00001U);
            break;
        default:
            tendon_put_float(bytes, 1.0f);
            break;
        }
        memcpy(&payload[k], bytes, (size - k < 4U) ? size - k : 4U);
    }
}

static void drain(void)
{
    uint8_t out[64];
    while (tendon_machine_send(&machine, out, 1U + below(sizeof out)) != 0U) {
    }
}

static void step(int32_t counts, uint32_t time_us, uint32_t fault)
{
    float torque[1];
    tendon_machine_step(&machine, &counts, time_us, fault, torque);
    if (!(torque[0] >= -TENDON_MOST_TORQUE && torque[0] <= TENDON_MOST_TORQUE)) {
        printf("a torque of %g\n", (double)torque[0]);
        abort();
    }
    if (!tendon_machine_enabled(&machine) && torque[0] != 0.0f) {
        puts("a torque without drives");
        abort();
    }
}

/* Whether a frame on the wire counts: every frame that does is answered. */
static bool taken(const uint8_t *wire, uint32_t count)
{
    static const uint8_t delimiter = 0U;
    const uint32_t before = machine.link.ack_head;
    machine.link.ack_tail = machine.link.ack_head;
    tendon_machine_receive(&machine, wire, count);
    tendon_machine_receive(&machine, &delimiter, 1U);
    return machine.link.ack_head != before;
}

static int flips(uint32_t pairs)
{
    static uint8_t wires[KINDS * 3U][WIRE];
    uint32_t sizes[KINDS * 3U];
    uint32_t singles = 0U;
    uint32_t single_taken = 0U;
    uint32_t pair_taken = 0U;
    for (uint32_t k = 0U; k < KINDS * 3U; ++k) {
        uint8_t payload[WIRE] = {0U};
        const uint32_t size = kinds[k / 3U].size;
        for (uint32_t i = 0U; (k % 3U != 0U) && (i < size); ++i) {
            payload[i] = (uint8_t)((k % 3U == 1U) ? 1U + below(255U) : chance());
        }
        sizes[k] = frame(kinds[k / 3U].type, chance() & 0xffffU, payload, size, wires[k]);
        if (!taken(wires[k], sizes[k])) {
            printf("message %u is refused\n", (unsigned)k);
            return 1;
        }
        for (uint32_t bit = 0U; bit < sizes[k] * 8U; ++bit) {
            wires[k][bit / 8U] ^= (uint8_t)(1U << (bit % 8U));
            single_taken += taken(wires[k], sizes[k]) ? 1U : 0U;
            wires[k][bit / 8U] ^= (uint8_t)(1U << (bit % 8U));
            ++singles;
        }
    }
    for (uint32_t p = 0U; p < pairs; ++p) {
        const uint32_t k = below(KINDS * 3U);
        const uint32_t a = below(sizes[k] * 8U);
        const uint32_t b = (a + 1U + below(sizes[k] * 8U - 1U)) % (sizes[k] * 8U);
        wires[k][a / 8U] ^= (uint8_t)(1U << (a % 8U));
        wires[k][b / 8U] ^= (uint8_t)(1U << (b % 8U));
        pair_taken += taken(wires[k], sizes[k]) ? 1U : 0U;
        wires[k][a / 8U] ^= (uint8_t)(1U << (a % 8U));
        wires[k][b / 8U] ^= (uint8_t)(1U << (b % 8U));
    }
    printf("singles=%u singles_taken=%u pairs=%u pairs_taken=%u\n", (unsigned)singles, (unsigned)single_taken, (unsigned)pairs,
        (unsigned)pair_taken);
    return 0;
}

static int by_chance(uint32_t count)
{
    uint32_t whole = 0U;
    uint32_t half = 0U;
    for (uint32_t k = 0U; k < count; ++k) {
        uint8_t plain[WIRE];
        uint8_t wire[WIRE];
        const uint32_t size = kinds[below(KINDS)].size + 10U;
        for (uint32_t i = 0U; i < size; ++i) {
            plain[i] = (uint8_t)chance();
        }
        half += (((tendon_crc32(0U, plain, size - 4U) ^ tendon_get_u32(&plain[size - 4U])) & 0xffffU) == 0U) ? 1U : 0U;
        whole += taken(wire, tendon_cobs_encode(plain, size, wire)) ? 1U : 0U;
    }
    printf("random=%u taken=%u sixteen=%u\n", (unsigned)count, (unsigned)whole, (unsigned)half);
    return 0;
}

static void say(uint32_t type, const uint8_t *payload, uint32_t size)
{
    uint8_t wire[WIRE];
    const uint32_t count = frame(type, (machine.link.sequence + 1U) & 0xffffU, payload, size, wire);
    tendon_machine_receive(&machine, wire, count);
    drain();
}

/* Messages of valid values: what the ranges allow, mostly ones. */
static void settle(uint32_t degree)
{
    uint8_t p[WIRE];
    uint8_t sum[4];
    uint32_t checksum = 0U;
    for (uint32_t kind = 1U; kind < 5U; ++kind) {
        for (uint32_t k = 0U; k < kinds[kind].size; k += 4U) {
            tendon_put_float(&p[k], 0.5f);
        }
        if (kinds[kind].type == TENDON_COMMAND_DRIVE) {
            tendon_put_float(&p[0], 1000.0f); /* rate */
            tendon_put_float(&p[8], 0.001f); /* position_per_count */
            tendon_put_u32(&p[12], below(5U)); /* zero */
        }
        if (kinds[kind].type == TENDON_COMMAND_SAFETY) {
            tendon_put_float(&p[4], 2.0f); /* speed */
            tendon_put_float(&p[8], -0.5f); /* low */
            tendon_put_u32(&p[20], 1U + below(100U)); /* jump */
            tendon_put_float(&p[24], 0.3f); /* frozen */
            tendon_put_u32(&p[28], below(200U)); /* saturated */
            tendon_put_u32(&p[32], 20U + below(50U)); /* silence */
            tendon_put_u32(&p[36], below(5U)); /* errors */
            tendon_put_u32(&p[40], below(1000U)); /* early */
            tendon_put_u32(&p[44], 1000U + below(1000U)); /* late */
            tendon_put_u32(&p[48], below(20U)); /* damping */
        }
        say(kinds[kind].type, p, kinds[kind].size);
    }
    memset(p, 0, sizeof p);
    tendon_put_u32(&p[0], 1U);
    tendon_put_u32(&p[4], below(2U));
    tendon_put_i32(&p[8], 1);
    tendon_put_u32(&p[12], degree + 1U);
    checksum = tendon_crc32(checksum, p, kinds[5].size);
    say(TENDON_COMMAND_TRAJECTORY, p, kinds[5].size);
    memset(p, 0, sizeof p);
    tendon_put_u32(&p[8], degree);
    tendon_put_float(&p[12], 0.02f);
    checksum = tendon_crc32(checksum, p, kinds[6].size);
    say(TENDON_COMMAND_PHASE, p, kinds[6].size);
    for (uint32_t row = 0U; row <= degree; row += TENDON_ROWS_A_MESSAGE) {
        tendon_put_u32(&p[0], row);
        for (uint32_t k = 4U; k < kinds[7].size; k += 4U) {
            tendon_put_float(&p[k], 0.01f * (float)below(30U));
        }
        checksum = tendon_crc32(checksum, p, kinds[7].size);
        say(TENDON_COMMAND_POINTS, p, kinds[7].size);
    }
    tendon_put_u32(sum, checksum);
    say(TENDON_COMMAND_COMMIT, sum, 4U);
}

static int frames(uint32_t count)
{
    uint32_t sequence = 0U;
    uint32_t states = 0U;
    uint32_t bad = 0U;
    uint32_t before = 0U;
    for (uint32_t k = 0U; k < count; ++k) {
        uint8_t wire[WIRE] = {0U};
        uint8_t payload[WIRE];
        uint32_t size = 0U;
        if (k % 256U == 0U) {
            /* Into the noise armed, running, or as it is. */
            const uint32_t far = below(3U);
            tendon_machine_start(&machine);
            settle(3U + below(27U));
            tendon_put_u32(&payload[0], 0U);
            tendon_put_u32(&payload[4], 1U);
            if (far > 0U) {
                say(TENDON_COMMAND_ARM, payload, 0U);
            }
            if (far > 1U) {
                say(TENDON_COMMAND_RUN, payload, 8U);
            }
        }
        if (below(4U) == 0U) {
            size = below(160U);
            for (uint32_t i = 0U; i < size; ++i) {
                wire[i] = (uint8_t)chance();
            }
        } else {
            const uint32_t kind = below(KINDS);
            const bool next = below(8U) != 0U;
            fill(payload, kinds[kind].size);
            sequence = next ? ((machine.link.sequence + 1U) & 0xffffU) : below(0x10000U);
            size = frame(kinds[kind].type, sequence, payload, kinds[kind].size, wire);
            for (uint32_t cuts = below(6U); cuts > 3U; --cuts) {
                const uint32_t at = below(size);
                if (below(2U) == 0U) {
                    wire[at] ^= (uint8_t)(1U << below(8U));
                } else if (below(2U) == 0U) {
                    memmove(&wire[at], &wire[at + 1U], size - at);
                    --size;
                } else {
                    memmove(&wire[at + 1U], &wire[at], size - at);
                    ++size;
                }
            }
        }
        before = rejected();
        for (uint32_t at = 0U; at < size;) {
            uint32_t piece = 1U + below(40U);
            piece = (piece < size - at) ? piece : size - at;
            tendon_machine_receive(&machine, &wire[at], piece);
            at += piece;
        }
        states |= 1U << machine.state.mode;
        bad += (rejected() > before) ? 1U : 0U;
        if (below(4U) == 0U) {
            step((int32_t)(below(3U) ? below(5U) : chance()), chance(), below(50U) ? 0U : chance());
        }
        if (below(4U) == 0U) {
            drain();
        }
    }
    printf("frames=%u bad=%u states=0x%x\n", (unsigned)count, (unsigned)bad, (unsigned)states);
    return 0;
}

static int script(void)
{
    uint32_t reasons = 0U;
    uint32_t now = 0U;
    uint32_t ran = 0U;
    static const uint8_t noise[] = {9U, 0U, 9U, 0U, 9U, 0U, 9U, 0U, 9U, 0U};
    for (uint32_t round = 0U; round < 400U; ++round) {
        uint8_t p[8];
        settle(3U + below(27U));
        say(TENDON_COMMAND_ARM, p, 0U);
        step(0, now += 1000U, 0U);
        tendon_put_u32(&p[0], below(100U));
        tendon_put_u32(&p[4], 1U + below(3U));
        say(TENDON_COMMAND_RUN, p, 8U);
        for (uint32_t k = 0U; k < 150U; ++k) {
            const int32_t counts = (int32_t)below(round % 3U) + (below(400U) ? 0 : (int32_t)below(200U));
            ran += machine.state.mode == TENDON_STATE_RUNNING ? 1U : 0U;
            step(counts, now += 1000U + (below(300U) ? 0U : below(3000U)), below(300U) ? 0U : 7U);
            if (below(20U) == 0U) {
                if (below(40U) == 0U) {
                    machine.link.sequence = (machine.link.sequence + 7U) & 0xffffU;
                } else if (below(40U) == 0U) {
                    tendon_machine_receive(&machine, noise, sizeof noise);
                } else {
                    /* All is well. */
                }
                say(TENDON_COMMAND_ALIVE, p, 0U);
            }
            drain();
        }
        say(TENDON_COMMAND_STOP, p, 0U);
        reasons |= 1U << machine.state.report.reason;
        for (uint32_t k = 0U; k < 25U; ++k) {
            step(0, now += 1000U, 0U);
        }
        say(TENDON_COMMAND_RESET, p, 0U);
        if (machine.state.mode != TENDON_STATE_IDLE) {
            puts("no reset");
            return 1;
        }
    }
    printf("reasons=0x%x ran=%u\n", (unsigned)reasons, (unsigned)ran);
    return 0;
}

int main(int count, char **arguments)
{
    const uint32_t many = (count > 2) ? (uint32_t)strtoul(arguments[2], NULL, 10) : 0U;
    int result = 2;
    seed = (count > 3) ? strtoull(arguments[3], NULL, 10) : 1U;
    tendon_machine_start(&machine);
    if ((count > 1) && (strcmp(arguments[1], "frames") == 0)) {
        result = frames(many);
    } else if ((count > 1) && (strcmp(arguments[1], "flips") == 0)) {
        result = flips(many);
    } else if ((count > 1) && (strcmp(arguments[1], "chance") == 0)) {
        result = by_chance(many);
    } else if ((count > 1) && (strcmp(arguments[1], "script") == 0)) {
        result = script();
    }
    return result;
}

/* The machine of a one-jointed arm under bytes that say what happens to it: for libFuzzer, which looks for bytes that
 * lead to new code, or with a driver of its own (-DPLAIN) that plays files and changes them at random:
 *   RUNS SEED FILES...
 * fuzz.c has the frames, a valid upload, and what must hold of a torque. */
#define main jobs
#include "fuzz.c"
#undef main

#define LONGEST 4096U

static const uint8_t *at;
static const uint8_t *end;
static uint32_t clock_us;

static uint32_t take(uint32_t bytes)
{
    uint32_t value = 0U;
    for (uint32_t k = 0U; (k < bytes) && (at < end); ++k) {
        value |= (uint32_t)*at << (8U * k);
        ++at;
    }
    return value;
}

static void take_frame(uint32_t sequence)
{
    uint8_t payload[WIRE] = {0U};
    uint8_t wire[WIRE];
    const uint32_t kind = take(1U) % KINDS;
    for (uint32_t k = 0U; (k < kinds[kind].size) && (at < end); ++k) {
        payload[k] = (uint8_t)take(1U);
    }
    tendon_machine_receive(&machine, wire, frame(kinds[kind].type, sequence, payload, kinds[kind].size, wire));
}

static void take_noise(void)
{
    const uint32_t most = take(1U);
    uint8_t bytes[256];
    uint32_t count = 0U;
    while ((count < most) && (at < end)) {
        bytes[count] = (uint8_t)take(1U);
        ++count;
    }
    tendon_machine_receive(&machine, bytes, count);
}

/* Words that change the state, of valid values. */
static void take_word(void)
{
    static const uint8_t words[] = {
        TENDON_COMMAND_ARM, TENDON_COMMAND_RUN, TENDON_COMMAND_ALIVE, TENDON_COMMAND_STOP, TENDON_COMMAND_RESET,
        TENDON_COMMAND_QUERY, TENDON_COMMAND_HELLO, TENDON_COMMAND_COMMIT};
    const uint8_t type = words[take(1U) % sizeof words];
    uint8_t payload[8];
    tendon_put_u32(&payload[0], take(1U));
    tendon_put_u32(&payload[4], 1U);
    say(type, payload, (type == TENDON_COMMAND_RUN) ? 8U : ((type == TENDON_COMMAND_COMMIT) ? 4U : 0U));
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    at = data;
    end = &data[(size < LONGEST) ? size : LONGEST];
    seed = 1U;
    clock_us = 0U;
    tendon_machine_start(&machine);
    while (at < end) {
        switch (take(1U) % 8U) {
        case 0U:
            settle(3U + (take(1U) % 27U));
            break;
        case 1U:
            take_frame((machine.link.sequence + 1U) & 0xffffU);
            break;
        case 2U:
            take_frame(take(2U));
            break;
        case 3U:
            take_noise();
            break;
        case 4U:
            clock_us += take(2U);
            step((int32_t)take(4U), clock_us, take(1U) % 3U ? 0U : take(4U));
            break;
        case 5U:
            for (uint32_t k = take(1U); k > 0U; --k) {
                step((int32_t)(k % 3U), clock_us += 1000U, 0U);
            }
            break;
        case 6U:
            take_word();
            break;
        default:
            drain();
            break;
        }
    }
    drain();
    return 0;
}

#ifdef PLAIN
static uint32_t read_file(const char *path, uint8_t *bytes)
{
    FILE *file = fopen(path, "rb");
    const uint32_t count = (file != NULL) ? (uint32_t)fread(bytes, 1U, LONGEST, file) : 0U;
    if (file != NULL) {
        fclose(file);
    }
    return count;
}

/* A few bytes changed, left out, doubled or taken from another file. */
static uint32_t change(uint8_t *bytes, uint32_t count, const uint8_t *other, uint32_t others, uint64_t *state)
{
    seed = *state;
    for (uint32_t changes = 1U + below(6U); (changes > 0U) && (count > 0U); --changes) {
        const uint32_t place = below(count);
        const uint32_t kind = below(4U);
        if (kind == 0U) {
            bytes[place] ^= (uint8_t)(1U << below(8U));
        } else if (kind == 1U) {
            bytes[place] = (uint8_t)chance();
        } else if ((kind == 2U) && (others > 0U)) {
            const uint32_t from = below(others);
            const uint32_t room = LONGEST - place;
            const uint32_t size = below(((others - from) < room) ? (others - from) : room);
            memcpy(&bytes[place], &other[from], size);
            count = (place + size > count) ? place + size : count;
        } else {
            memmove(&bytes[place], &bytes[place + 1U], count - place - 1U);
            --count;
        }
    }
    *state = seed;
    return count;
}

int main(int count, char **arguments)
{
    const uint32_t runs = (count > 1) ? (uint32_t)strtoul(arguments[1], NULL, 10) : 0U;
    uint64_t state = (count > 2) ? strtoull(arguments[2], NULL, 10) : 1U;
    const uint32_t files = (count > 3) ? (uint32_t)(count - 3) : 0U;
    static uint8_t bytes[LONGEST];
    static uint8_t other[LONGEST];
    uint32_t states = 0U;
    for (uint32_t k = 0U; k < files; ++k) {
        (void)LLVMFuzzerTestOneInput(bytes, read_file(arguments[3U + k], bytes));
        states |= 1U << machine.state.mode;
    }
    for (uint32_t k = 0U; (k < runs) && (files > 0U); ++k) {
        uint32_t size = read_file(arguments[3U + (k % files)], bytes);
        seed = state;
        const uint32_t others = read_file(arguments[3U + below(files)], other);
        state = seed;
        size = change(bytes, size, other, others, &state);
        (void)LLVMFuzzerTestOneInput(bytes, size);
        states |= 1U << machine.state.mode;
    }
    printf("files=%u runs=%u states=0x%x\n", (unsigned)files, (unsigned)runs, (unsigned)states);
    return 0;
}
#endif

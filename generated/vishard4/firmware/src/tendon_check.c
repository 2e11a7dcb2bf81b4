/* Part of Tendon; do not edit a copy. Checks of commands: size, state and ranges of values. */
#include "tendon_check.h"

#define WORD 4U /* bytes of a value */
#define EXPONENT 0x7f800000U
#define SIGN 0x80000000U

/* A number's bits as a key that compares as the number does. Keys of NaN and infinity are beyond all others. */
TENDON_SMALL static uint32_t ordered(uint32_t bits, uint32_t kind)
{
    uint32_t key = bits;
    if (kind == TENDON_KIND_REAL) {
        key = ((bits & SIGN) != 0U) ? ~bits : (bits | SIGN);
    } else if (kind == TENDON_KIND_SIGNED) {
        key = bits ^ SIGN;
    } else {
        /* The bits of a count are its key. */
    }
    return key;
}

TENDON_SMALL static uint32_t check_values(const tendon_rule *r, const uint8_t *payload, uint32_t *detail)
{
    uint32_t result = TENDON_RESULT_DONE;
    for (uint32_t k = 0U; (k < r->count) && (result == TENDON_RESULT_DONE); ++k) {
        const uint32_t place = (uint32_t)r->first + k;
        const uint32_t bits = tendon_get_u32(&payload[place * WORD]);
        const uint32_t key = ordered(bits, r->kind);
        if ((r->kind == TENDON_KIND_REAL) && ((bits & EXPONENT) == EXPONENT)) {
            result = TENDON_RESULT_NOT_FINITE;
            *detail = place;
        } else if ((key < r->low) || (key > r->high)) {
            result = TENDON_RESULT_OUT_OF_RANGE;
            *detail = place;
        } else {
            /* Within its range. */
        }
    }
    return result;
}

uint32_t tendon_check_command(
    uint32_t type,
    uint32_t length,
    const uint8_t *payload,
    uint32_t state,
    uint32_t *detail)
{
    const uint32_t place = type - TENDON_FIRST_COMMAND; /* wraps below the first one */
    uint32_t result = TENDON_RESULT_UNKNOWN;
    *detail = 0U;
    if (place < TENDON_COMMANDS) {
        const tendon_command *c = &tendon_commands[place];
        if (length != c->size) {
            /* Unknown. */
        } else if ((((uint32_t)c->states >> state) & 1U) == 0U) {
            result = TENDON_RESULT_STATE;
            *detail = state;
        } else {
            result = TENDON_RESULT_DONE;
            for (uint32_t k = 0U; (k < c->rules) && (result == TENDON_RESULT_DONE); ++k) {
                result = check_values(&tendon_rules[(uint32_t)c->first + k], payload, detail);
            }
        }
    }
    return result;
}

/* Part of Tendon; do not edit a copy. Which commands can be taken. */
#ifndef TENDON_CHECK_H
#define TENDON_CHECK_H

#include <stdint.h>

#include "tendon_frame.h"
#include "tendon_messages.h"

/* How the four bytes of a value are read. */
#define TENDON_KIND_REAL 0U
#define TENDON_KIND_SIGNED 1U
#define TENDON_KIND_COUNT 2U

/* The values of a command from `first` on, `count` of them, lie between the ends of a range, ends included. */
typedef struct {
    uint16_t first;
    uint8_t count;
    uint8_t kind;
    uint32_t low; /* a key, which compares as the number does: of a real one, its bits with the sign turned round */
    uint32_t high;
} tendon_rule;

/* A command: its payload's bytes, the states in which it is taken as bits, its rules. */
typedef struct {
    uint16_t size;
    uint16_t states;
    uint16_t first;
    uint16_t rules;
} tendon_command;

/* The arm's own, in tendon_messages.c. Commands by type, from TENDON_FIRST_COMMAND on. */
extern const tendon_rule tendon_rules[TENDON_RULES];
extern const tendon_command tendon_commands[TENDON_COMMANDS];

/* Whether a command of this type and payload can be taken in this state: done, or why not. `detail`: PROTOCOL.md. */
TENDON_SMALL uint32_t tendon_check_command(
    uint32_t type,
    uint32_t length,
    const uint8_t *payload,
    uint32_t state,
    uint32_t *detail);

#endif

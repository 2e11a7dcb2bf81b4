/* Part of Tendon; do not edit a copy. Checks of commands. */
#ifndef TENDON_CHECK_H
#define TENDON_CHECK_H

#include <stdint.h>

#include "tendon_frame.h"
#include "tendon_messages.h"

/* Types of the four bytes of a value. */
#define TENDON_KIND_REAL 0U
#define TENDON_KIND_SIGNED 1U
#define TENDON_KIND_COUNT 2U

/* `count` values of a command, from `first` on, must lie in a range, ends included. */
typedef struct {
    uint16_t first;
    uint8_t count;
    uint8_t kind;
    uint32_t low; /* key of the lower end, see tendon_check.c */
    uint32_t high;
} tendon_rule;

/* A command: bytes of its payload, states in which it is accepted as bits, and its rules. */
typedef struct {
    uint16_t size;
    uint16_t states;
    uint16_t first;
    uint16_t rules;
} tendon_command;

/* The tables of the arm, in tendon_messages.c. Commands are in order of their type, from TENDON_FIRST_COMMAND on. */
extern const tendon_rule tendon_rules[TENDON_RULES];
extern const tendon_command tendon_commands[TENDON_COMMANDS];

/* Whether a command is accepted in this state. Returns a TENDON_RESULT_...; detail: PROTOCOL.md. */
TENDON_SMALL uint32_t tendon_check_command(
    uint32_t type,
    uint32_t length,
    const uint8_t *payload,
    uint32_t state,
    uint32_t *detail);

#endif

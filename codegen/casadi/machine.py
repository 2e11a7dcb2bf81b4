"""The C that runs a CasADi function at many places at once.

CasADi's own machine goes through the instructions of a function for one place after another, and what an instruction
costs is mostly to find out which one it is. Here each register holds several places, so that they share that cost and
the processor's vectors do the rest. The operations and their order are CasADi's, so the numbers are, too, bit for bit.
"""

from __future__ import annotations

from string import Template

LANES = 16
"""Places a register: the registers of a function of some thousand instructions stay in the nearest cache."""

OPERATIONS = {
    "CONST": "",
    "INPUT": "",
    "OUTPUT": "",
    "ASSIGN": "x",
    "ADD": "x + y",
    "SUB": "x - y",
    "MUL": "x * y",
    "DIV": "x / y",
    "NEG": "-x",
    "EXP": "exp(x)",
    "LOG": "log(x)",
    "POW": "pow(x, y)",
    "CONSTPOW": "pow(x, y)",
    "SQRT": "sqrt(x)",
    "SQ": "x * x",
    "TWICE": "2.0 * x",
    "SIN": "sin(x)",
    "COS": "cos(x)",
    "TAN": "tan(x)",
    "ASIN": "asin(x)",
    "ACOS": "acos(x)",
    "ATAN": "atan(x)",
    "LT": "x < y",
    "LE": "x <= y",
    "EQ": "x == y",
    "NE": "x != y",
    "NOT": "x == 0.0",
    "AND": "x != 0.0 && y != 0.0",
    "OR": "x != 0.0 || y != 0.0",
    "FLOOR": "floor(x)",
    "CEIL": "ceil(x)",
    "FMOD": "fmod(x, y)",
    "FABS": "fabs(x)",
    "SIGN": "x < 0.0 ? -1.0 : x > 0.0 ? 1.0 : x",
    "COPYSIGN": "copysign(x, y)",
    "IF_ELSE_ZERO": "x != 0.0 ? y : 0.0",
    "ERF": "erf(x)",
    "FMIN": "fmin(x, y)",
    "FMAX": "fmax(x, y)",
    "INV": "1.0 / x",
    "SINH": "sinh(x)",
    "COSH": "cosh(x)",
    "TANH": "tanh(x)",
    "ASINH": "asinh(x)",
    "ACOSH": "acosh(x)",
    "ATANH": "atanh(x)",
    "ATAN2": "atan2(x, y)",
    "LOG1P": "log1p(x)",
    "EXPM1": "expm1(x)",
    "HYPOT": "hypot(x, y)",
}
"""CasADi's names, without OP_, and what they compute of x and y; their numbers are their places here, as the library
says itself. The first three move numbers."""

_PAGE = Template("""\
/* Runs a CasADi function, instruction after instruction, at many places at once: each register holds $lanes of them.
 * An instruction is four numbers: operation, result, operands. */
#include <math.h>
#include <stddef.h>
#include <stdint.h>

enum { LANES = $lanes };

const int32_t tendon_machine_lanes = LANES;
const char tendon_machine_operations[] = "$names";

void tendon_machine_run(size_t count, size_t instructions, const int32_t *code, const double *constants,
                        double (*registers)[LANES], const double *const *in, const size_t *in_size,
                        double *const *out, const size_t *out_size);

void tendon_machine_run(size_t count, size_t instructions, const int32_t *code, const double *constants,
                        double (*registers)[LANES], const double *const *in, const size_t *in_size,
                        double *const *out, const size_t *out_size)
{
    for (size_t first = 0; first < count; first += LANES) {
        const size_t here = count - first < LANES ? count - first : LANES;
        for (size_t k = 0; k < instructions; ++k) {
            const int32_t *const now = code + 4 * k;
            const size_t r = (size_t)now[1], m = (size_t)now[2], n = (size_t)now[3];
            switch (now[0]) {
            case 0:
                for (size_t i = 0; i < LANES; ++i)
                    registers[r][i] = constants[m];
                break;
            case 1:
                /* Past the last place the last one is done again. */
                for (size_t i = 0; i < LANES; ++i)
                    registers[r][i] = in[m][(first + (i < here ? i : here - 1)) * in_size[m] + n];
                break;
            case 2:
                for (size_t i = 0; i < here; ++i)
                    out[r][(first + i) * out_size[r] + n] = registers[m][i];
                break;
$operations
            default:
                break;
            }
        }
    }
}
""")
_UNARY = Template("""\
            case $number:
                for (size_t i = 0; i < LANES; ++i) {
                    const double x = registers[m][i];
                    registers[r][i] = $value;
                }
                break;""")
_BINARY = Template("""\
            case $number:
                for (size_t i = 0; i < LANES; ++i) {
                    const double x = registers[m][i], y = registers[n][i];
                    registers[r][i] = $value;
                }
                break;""")


def machine_page() -> str:
    """The whole file."""
    computing = list(enumerate(OPERATIONS.values()))[3:]
    cases = [(_BINARY if "y" in value else _UNARY).substitute(number=n, value=value) for n, value in computing]
    return _PAGE.substitute(lanes=LANES, names=" ".join(OPERATIONS), operations="\n".join(cases))

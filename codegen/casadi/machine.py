"""The C that evaluates a CasADi function at many points at once.

CasADi's own virtual machine evaluates one point at a time and spends most of its time on dispatching instructions. Here
each register holds several points, which share the dispatch and fill the processor's vectors. The operations and their
order are CasADi's, so the results are the same bit for bit.
"""

from __future__ import annotations

from codegen.pages import page

LANES = 16
"""Points a register: small enough that the registers of some thousand instructions stay in the first-level cache."""

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
"""CasADi's operations, named without OP_, as C of the operands x and y. An operation's code is its position; the first
three move values."""


def machine_page() -> str:
    """The C source, from casadi/machine.c.j2."""
    return page("casadi/machine.c.j2", lanes=LANES, names=list(OPERATIONS), values=list(OPERATIONS.values())[3:])

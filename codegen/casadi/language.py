"""How CasADi's Python spells a tape whose switches are lowered to surrogates."""

from __future__ import annotations

import keyword

from codegen.tape.printers import Language, float64

_CALLS = {
    "exp": "ca.exp",
    "log": "ca.log",
    "sqrt": "ca.sqrt",
    "abs": "ca.fabs",
    "atan2": "ca.atan2",
    "max": "ca.fmax",
    "min": "ca.fmin",
    "sgn": "ca.sign",
    "pow": "_power",
    "rise": "_rise",
}
"""Those that begin with _ are defined in the page."""


def _pair(sine: str | None, cosine: str | None, angle: str) -> list[str]:
    lines = [f"{sine} = ca.sin({angle})"] if sine else []
    return lines + ([f"{cosine} = ca.cos({angle})"] if cosine else [])


CASADI = Language(
    literal=float64,
    call=lambda op, arguments: f"{_CALLS[op]}({', '.join(arguments)})",
    pair=_pair,
    assign=lambda name, text: f"{name} = {text}",
    reserved=frozenset(keyword.kwlist) | {"ca"},
)

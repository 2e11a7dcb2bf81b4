"""The controller of an arm: its structs, the functions it compensates with, and the holes of its pages."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import sympy as sp

from codegen.c.c_code import F32, Routine, assign, comment, declaration, describe, indent, notation, unused
from codegen.c.controller_records import COORDINATES, MAX_DEGREE, MIN_DEGREE, STATUS, controller_records
from codegen.c.records import Record, size_lines
from codegen.tape.printers import Printer
from codegen.tape.tape import Tape
from symbolic.controller_law import Compensation, Spring, compensation
from symbolic.effects.declaration import Effect
from symbolic.functions import SymbolicFunction
from symbolic.model import ArmModel

STRUCTS = {"parameters": "parameters", "effects": "effects", "springs": "spring", "contact": "contact"}
"""The arguments that are structs, and what their records are called."""


@dataclass(frozen=True)
class Controller:
    """records: in order of declaration, those of the arm's own header first."""

    model: ArmModel
    compensation: Compensation
    records: tuple[Record, ...]

    @classmethod
    def of(cls, model: ArmModel, library: Mapping[str, Effect]) -> Controller:
        """The controller of an arm; `library`: all effects by name."""
        found = compensation(model, library)
        return cls(model, found, controller_records(model, found))

    @property
    def holes(self) -> dict[str, Any]:
        """What the pages of header and source need, as finished strings."""
        name = self.model.arm.name
        inverse = self.model.function("inverse_dynamics")
        return {
            "name": name,
            "NAME": name.upper(),
            "n": len(self.model.arm.joints),
            "guard": f"TENDON_{name.upper()}_CONTROLLER_F32_H",
            "compensated": self._coverage(),
            "price": self._price(),
            "min_degree": MIN_DEGREE,
            "max_degree": MAX_DEGREE,
            "coordinates": COORDINATES,
            "status": [
                {"name": flag.upper(), "bit": bit, "comment": comment(text)} for flag, (bit, text) in STATUS.items()
            ],
            "types": [record.typedef() for record in self.records if not record.declared],
            "routines": [self._routine(function) for function in (inverse, *self.compensation.functions)],
            "reciprocals": [F32.language.literal(Fraction(1, max(k, 1))) for k in range(MAX_DEGREE - 1)],
            "sizes": size_lines(self.records, "sizes"),
        }

    @property
    def has_contact_coordinates(self) -> bool:
        """Whether the arm has the coordinates w of a contact phase."""
        return any(function.name == "contact_inverse" for function in self.model.functions)

    def _coverage(self) -> str:
        c = self.compensation
        return comment(
            "Compensated: the trajectory's springs and plate" + "".join(f", {site}" for site in c.compensated) + ".",
            *(f"Not compensated: {site} ({site.obstacle})." for site in c.uncompensated),
        )

    def _price(self) -> str:
        """Operations of a step in a free phase, conversions, comparisons and signs apart."""
        n = len(self.model.arm.joints)
        inverse = self.model.function("inverse_dynamics")
        total: Counter[str] = Counter(Tape.of(inverse).count())
        total.update(Tape.of(self.compensation.functions[0]).count())
        # A joint takes 4 for its measurement, 7 for its drive and 6 M - 1 for its polynomial; the weights of the
        # polynomials and the time take 4 M - 1.
        fixed = total["arithmetic"] - total["neg"] + n * (4 + 7 - 1) - 1
        others = " and ".join(f"{total[op]} {op}" for op in ("sincos", "exp", "rise") if total[op])
        return f"Operations in a free phase of degree M: {fixed} + {6 * n + 4} M" + (f", {others}." if others else ".")

    def _routine(self, function: SymbolicFunction) -> Routine:
        """As codegen.c.c_code.call, with a struct for each of the first arguments; where it is called, so that the
        compiler keeps the motion in registers."""
        tape = Tape.of(function)
        spelling = _brought(self.compensation)
        for a in function.arguments:
            pattern = "{name}->{symbol}" if a.name in STRUCTS else "{name}[{i}]"
            for i, symbol in enumerate(a.symbols):
                spelling.setdefault(symbol, pattern.format(name=a.name, symbol=symbol.name, i=i))
        output = function.outputs[0]
        taken = frozenset({a.name for a in function.arguments} | {output.name})
        lines, texts = Printer(F32.language, tape, spelling, taken).print()
        lines = unused(function, tape) + lines
        lines += assign([f"{output.name}[{i}]" for i in range(len(texts))], texts)
        head = f"static inline void {function.name}"
        body = notation(function, tape) + indent(lines, 1)
        return Routine(describe(function, tape), declaration(head, self._arguments(function)), body)

    def probe(self) -> str:
        """C that gives the inner functions of a step names of their own, so that they can be called and compared."""
        parts = [f'#include "{self.model.arm.name}_controller_f32.inc"']
        for function in self.compensation.functions:
            head = declaration(f"void {self.model.arm.name}_{function.name}_f32", self._arguments(function))
            names = [*(a.name for a in function.arguments), function.outputs[0].name]
            call = f"{function.name}({', '.join(names)});"
            parts.append(f"{head};\n\n{head}\n{{\n    {call}\n}}")
        return "\n\n".join(parts) + "\n"

    def _arguments(self, function: SymbolicFunction) -> list[str]:
        name, output = self.model.arm.name, function.outputs[0]
        inputs = [
            f"const {name}_{STRUCTS[a.name]}_f32 *{a.name}"
            if a.name in STRUCTS
            else f"const float {a.name}[{len(a.symbols)}]"
            for a in function.arguments
        ]
        return [*inputs, f"float {output.name}[{len(output.expressions)}]"]

    def document(self) -> dict[str, Any]:
        """controller.json: for whoever fills the structs. A value is null where the model file has none."""
        c = self.compensation
        values = zip(c.effects.symbols, c.effects.defaults, strict=True)
        return {
            "name": self.model.arm.name,
            "n": len(self.model.arm.joints),
            "records": [record.to_json() for record in self.records],
            "coordinates": COORDINATES,
            "status": {flag: bit for flag, (bit, _) in STATUS.items()},
            "min_degree": MIN_DEGREE,
            "max_degree": MAX_DEGREE,
            "springs": {p.name: _powers(c.springs[0], product) for p, product in c.springs[0].lumps},
            **_others(c),
            "effects": {symbol.name: value for symbol, value in values},
            "compensated": [str(site) for site in c.compensated],
            "uncompensated": [{"effect": str(site), "reason": site.obstacle} for site in c.uncompensated],
            "operations": {f.name: Tape.of(f).count() for f in c.functions},
        }


def _brought(found: Compensation) -> dict[sp.Symbol, str]:
    """How the parameters of what a trajectory brings are spelt."""
    spelling = {
        symbol: f"contact->{site.effect.name}_{p.name}"
        for site in found.touched
        for symbol, p in zip(site.symbols, site.effect.parameters, strict=True)
    }
    for spring in found.springs:
        names = zip(spring.symbols, spring.names, strict=True)
        spelling |= {symbol: f"springs[{spring.joint - 1}].{name}" for symbol, name in names}
    return spelling


def _others(found: Compensation) -> dict[str, Any]:
    """Springs beside the usual one, if there are any: by effect, the parameter that stands in each field."""
    others = [spring for spring in found.springs if spring.joint == 1 and not spring.usual]
    fields = {s.effect.name: {n: p.name for n, (p, _) in zip(s.names, s.lumps, strict=True)} for s in others}
    return {"other_springs": fields} if fields else {}


def _powers(spring: Spring, product: sp.Expr) -> dict[str, int]:
    """A product of a spring's own parameters as their powers, for whoever computes it."""
    powers = product.as_powers_dict()
    return {p.name: int(powers[p.symbol]) for p in spring.effect.parameters if p.symbol in powers}

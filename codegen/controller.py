"""The controller of an arm: its structs, the functions it compensates with, and the holes of its pages."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from math import isfinite
from typing import Any

import sympy as sp

from codegen.c_code import F32, Routine, assign, comment, declaration, describe, indent, unused
from codegen.controller_records import COORDINATES, MAX_DEGREE, STATUS, controller_records
from codegen.printers import Printer
from codegen.records import Record, size_lines
from codegen.tape import Tape
from symbolic.compensation import PLATE_SITES, Compensation, Site, compensation, spring_sites
from symbolic.effects.declaration import Effect
from symbolic.functions import SymbolicFunction
from symbolic.model import ArmModel


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
        return {
            "name": name,
            "NAME": name.upper(),
            "n": len(self.model.arm.joints),
            "guard": f"TENDON_{name.upper()}_CONTROLLER_F32_H",
            "compensated": self._coverage(),
            "price": self._price(),
            "max_degree": MAX_DEGREE,
            "coordinates": COORDINATES,
            "status": [
                {"name": flag.upper(), "bit": bit, "comment": comment(text)} for flag, (bit, text) in STATUS.items()
            ],
            "types": [record.typedef() for record in self.records if not record.declared],
            "routines": [self._routine(function) for function in self.compensation.functions],
            "reciprocals": [F32.language.literal(Fraction(1, max(k, 1))) for k in range(MAX_DEGREE - 1)],
            "sizes": size_lines(self.records, "sizes"),
        }

    @property
    def has_contact_coordinates(self) -> bool:
        return any(function.name == "contact_inverse" for function in self.model.functions)

    def _coverage(self) -> str:
        c = self.compensation
        return comment(
            "Compensated: the trajectory's springs and plate" + "".join(f", {site}" for site in c.compensated) + ".",
            *(f"Not compensated: {site} ({site.obstacle})." for site in c.uncompensated),
        )

    def _price(self) -> str:
        """Operations of a step in a free phase, conversions and comparisons apart."""
        n = len(self.model.arm.joints)
        inverse = self.model.function("inverse_dynamics")
        total: Counter[str] = Counter(Tape.of(inverse).count())
        total.update(Tape.of(self.compensation.functions[0]).count())
        # A joint takes 6 for its measurement, 9 for its drive and 6 M + 2 for its polynomial; the weights of the
        # polynomials and the time take 5 M + 1.
        fixed = total["arithmetic"] + n * (6 + 9 + 2) + 1
        others = " and ".join(f"{total[op]} {op}" for op in ("sincos", "exp") if total[op])
        return f"Operations in a free phase of degree M: {fixed} + {6 * n + 5} M" + (f", {others}." if others else ".")

    def _routine(self, function: SymbolicFunction) -> Routine:
        """As codegen.c_code.call, with a struct for each of the first three arguments."""
        name, tape = self.model.arm.name, Tape.of(function)
        spelling: dict[sp.Symbol, str] = {}
        arguments = []
        for a in function.inputs:
            record = {"parameters": "parameters", "effects": "effects", "springs": "spring", "contact": "contact"}
            if a.name in record:
                arguments.append(f"const {name}_{record[a.name]}_f32 *{a.name}")
                spelling |= {s: f"{a.name}->{s.name}" for s in a.symbols}
            else:
                arguments.append(f"const float {a.name}[{len(a.symbols)}]")
                spelling |= {s: f"{a.name}[{i}]" for i, s in enumerate(a.symbols)}
        spelling |= _members(spring_sites(len(self.model.arm.joints)), "springs[{index}].{parameter}")
        spelling |= _members(PLATE_SITES, "contact->{effect}_{parameter}")
        output = function.outputs[0]
        arguments.append(f"float {output.name}[{len(output.expressions)}]")
        taken = frozenset({a.name for a in function.inputs} | {output.name})
        lines, texts = Printer(F32.language, tape, spelling, taken).print()
        lines = unused(function, tape) + lines
        lines += assign([f"{output.name}[{i}]" for i in range(len(texts))], texts)
        head = f"void {name}_{function.name}_f32"
        return Routine(describe(function, tape), declaration(head, arguments), indent(lines, 1))

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
            "max_degree": MAX_DEGREE,
            "effects": {symbol.name: value if isfinite(value) else None for symbol, value in values},
            "compensated": [str(site) for site in c.compensated],
            "uncompensated": [{"effect": str(site), "reason": site.obstacle} for site in c.uncompensated],
            "operations": {f.name: Tape.of(f).count() for f in c.functions},
        }


def _members(sites: tuple[Site, ...], pattern: str) -> dict[sp.Symbol, str]:
    """How the parameters of what a trajectory brings are spelt."""
    return {
        symbol: pattern.format(index=(site.joint or 1) - 1, effect=site.effect.name, parameter=p.name)
        for site in sites
        for symbol, p in zip(site.symbols, site.effect.parameters, strict=True)
    }

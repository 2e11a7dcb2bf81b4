"""The controller of an arm: its structs, its compensation, and the holes of its templates."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

import sympy as sp

from codegen.c.c_code import F32, Routine, assign, comment, declaration, describe, indent, notation, unused
from codegen.c.monitor import ModelMonitor
from codegen.c.records import Record, RecordField, of_struct
from codegen.c.statistics import ModelStatistics
from codegen.tape.printers import Printer
from codegen.tape.tape import Tape
from symbolic.controller_law import Compensation, Spring, compensation
from symbolic.effects.declaration import Effect
from symbolic.functions import Coordinates, SymbolicFunction
from symbolic.model import ArmModel

MAX_DEGREE = 29
"""Up to this degree, binomial coefficients times the degree fit into 32 bits."""
MIN_DEGREE = 4
"""The step reads this many points outside its loop."""
COORDINATES = {"q": 0, "w": 1}
STATUS = {
    "saturated": (1, "a torque was limited"),
    "finished": (2, "the trajectory has ended, the arm is held there"),
    "invalid": (4, "no trajectory, or a torque that is no finite number: all torques are zero"),
}


_RECORDS: Mapping[str, tuple[str, Sequence[tuple[str, str, str, str]]]] = {
    "config": (
        "The arm, its encoders and its gains; {name}_controller_prepare_f32 fills the last two fields.",
        [
            ("parameters", "{name}_parameters_f32", "", "of the arm"),
            ("effects", "{name}_effects_f32", "", "that are compensated"),
            ("rate", "float", "Hz", "of the control step"),
            ("velocity_gain", "float", "1", "of the low-pass on the rates: 1 - exp(-2 pi cut-off/rate)"),
            ("position_per_count", "float[n]", "rad|m", "of one encoder count"),
            ("zero", "int32_t[n]", "counts", "where the position is 0"),
            ("kp", "float[n]", "N m/rad|N/m", "torque per error of position"),
            ("kd", "float[n]", "N m s/rad|N s/m", "torque per error of rate"),
            ("torque_limit", "float[n]", "N m|N", "largest torque in either direction"),
            ("kept", "float", "1", "1 - velocity_gain"),
            ("rate_per_count", "float[n]", "rad/s|m/s", "that a count a period adds to the filtered rate"),
        ],
    ),
    "phase": (
        "A part of a trajectory, equation (9); {name}_controller_prepare_phase_f32 fills the last three fields.",
        [
            ("coordinates", "uint32_t", "", "{NAME}_JOINT_COORDINATES or {NAME}_CONTACT_COORDINATES, equation (13)"),
            ("degree", "uint32_t", "", "of the polynomials, {least} to {NAME}_MAX_DEGREE"),
            ("duration", "float", "s", "not less than a control period"),
            ("points", "float *", "", "degree + 1 control points of {n} coordinates each"),
            ("contact", "{name}_contact_f32 *", "", "the plate that it touches, or null"),
            ("spread", "float", "1", "degree - 1"),
            ("first", "float", "1/s", "degree/duration: of the first derivative"),
            ("second", "float", "1/s^2", "first (degree - 1)/duration: of the second derivative"),
        ],
    ),
    "trajectory": (
        "What the controller follows.",
        [
            ("count", "uint32_t", "", "of the phases"),
            ("periodic", "uint32_t", "", "1: the first phase follows the last one; 0: the arm rests at the end"),
            ("elbow", "float", "1", "sign of sin q_2 in contact coordinates"),
            ("springs", "{name}_spring_f32[n]", "", "parallel to the joints"),
            ("phases", "{name}_phase_f32 *", "", "one after another"),
        ],
    ),
    "state": (
        "What the controller keeps between two steps.",
        [
            ("counts", "int32_t[n]", "counts", "of the last step"),
            ("q", "float[n]", "rad|m", "measured"),
            ("qd", "float[n]", "rad/s|m/s", "measured and filtered"),
            ("phase", "uint32_t", "", "from 0"),
            ("tick", "uint32_t", "", "periods since tick 0"),
            ("begin", "float", "s", "time within the phase at tick 0"),
            ("elapsed", "float", "s", "time within the phase now"),
            ("finished", "uint32_t", "", "1: at rest at the end"),
        ],
    ),
    "output": (
        "What a step gives.",
        [
            ("torque", "float[n]", "N m|N", "to hold until the next step"),
            ("q_desired", "float[n]", "rad|m", "by the trajectory"),
            ("phase", "uint32_t", "", "of the trajectory, from 0"),
            ("status", "uint32_t", "", "bits: {flags}"),
        ],
    ),
}
"""Meaning and fields of the structs that every arm has. A field has a name, a type ([n]: a value a joint; *: pointer),
a unit ("rad|m": rad for revolute joints, m for prismatic ones) and a meaning."""


_WITH_MONITOR = {
    "config": (
        "monitor",
        "{name}_monitor_config_f32",
        "",
        "from the model file",
    ),
    "state": ("monitor", "{name}_monitor_state_f32", "", "whether the model still holds; a reset leaves it as it is"),
}
"""The last field of two structs of an arm whose model is watched."""


def controller_records(model: ArmModel, found: Compensation, monitor: ModelMonitor | None) -> tuple[Record, ...]:
    """All structs in order of declaration, beginning with that of the arm's own header, then the monitor's."""
    name, n = model.arm.name, len(model.arm.joints)
    unit = Coordinates(tuple(joint.type for joint in model.arm.joints)).unit
    flags = ", ".join(f"{name.upper()}_{flag.upper()}" for flag in STATUS)
    words = {"name": name, "NAME": name.upper(), "n": n, "least": MIN_DEGREE, "flags": flags}
    springs = [
        RecordField(field, "float", unit(p.unit.text("revolute"), p.unit.text("prismatic")), p.meaning)
        for spring in found.springs
        if spring.joint == 1
        for field, (p, _) in zip(spring.names, spring.lumps, strict=True)
    ]
    contact = [
        RecordField(f"{site.effect.name}_{p.name}", "float", p.unit.text(), p.meaning)
        for site in found.touched
        for p in site.effect.parameters
    ]
    note = "A spring parallel to a joint, equation (2); all zero where there is none."
    records = [
        of_struct(f"{name}_parameters_f32", "", model.struct, declared=True),
        of_struct(f"{name}_effects_f32", "Parameters of the effects that are compensated.", found.effects),
        Record(f"{name}_spring_f32", note, tuple(springs)),
        Record(f"{name}_contact_f32", "The plate, equation (3), and its damper.", tuple(contact)),
    ]
    if monitor is not None:
        records[1:1] = monitor.records
    for short, (meaning, own) in _RECORDS.items():
        rows = [*own, _WITH_MONITOR[short]] if monitor is not None and short in _WITH_MONITOR else own
        fields = [
            RecordField(
                field,
                kind.removesuffix("[n]").removesuffix(" *").format(**words),
                unit(*text.split("|")) if "|" in text else text,
                meaning=what.format(**words),
                count=n if kind.endswith("[n]") else None,
                pointer=kind.endswith("*"),
            )
            for field, kind, text, what in rows
        ]
        records.append(Record(f"{name}_{short}_f32", meaning.format(**words), tuple(fields)))
    return tuple(records)


STRUCTS = {"parameters": "parameters", "effects": "effects", "springs": "spring", "contact": "contact"}
"""Arguments that are structs, and the names of their records."""


@dataclass(frozen=True)
class Controller:
    """The controller of an arm. records: in order of declaration, that of the arm's own header first.

    monitor      of the model, which it asks in every step; None where the model file has none
    statistics   which the firmware adds up; None where the model file asks for none
    """

    model: ArmModel
    compensation: Compensation
    records: tuple[Record, ...]
    monitor: ModelMonitor | None = None
    statistics: ModelStatistics | None = None

    @classmethod
    def of(cls, model: ArmModel, library: Mapping[str, Effect]) -> Controller:
        """The controller of an arm. library: all effects by name."""
        found, monitor = compensation(model, library), ModelMonitor.of(model, library)
        return cls(model, found, controller_records(model, found, monitor), monitor, ModelStatistics.of(model, library))

    @property
    def holes(self) -> dict[str, object]:
        """The holes of header and source."""
        name = self.model.arm.name
        inverse = self.model.function("inverse_dynamics")
        return {
            "name": name,
            "NAME": name.upper(),
            "n": len(self.model.arm.joints),
            "guard": f"TENDON_{name.upper()}_CONTROLLER_F32_H",
            "monitored": self.monitor is not None,
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
            "sizes": [f"sizes[{i}] = (uint32_t)sizeof({r.name});" for i, r in enumerate(self.records)],
        }

    @property
    def has_contact_coordinates(self) -> bool:
        """Whether the arm has contact coordinates w."""
        return any(function.name == "contact_inverse" for function in self.model.functions)

    def _coverage(self) -> str:
        c = self.compensation
        return comment(
            "Compensated: the trajectory's springs and plate" + "".join(f", {site}" for site in c.compensated) + ".",
            *(f"Not compensated: {site} ({site.obstacle})." for site in c.uncompensated),
        )

    def _price(self) -> str:
        """Operations of a step in a free phase, without conversions, comparisons and signs."""
        n = len(self.model.arm.joints)
        inverse = self.model.function("inverse_dynamics")
        total: Counter[str] = Counter(Tape.of(inverse).count())
        total.update(Tape.of(self.compensation.functions[0]).count())
        # Per joint: 4 for measurement, 7 for the drive, 6 M - 1 for the polynomial; once 4 M - 1 for weights and time.
        fixed = total["arithmetic"] - total["neg"] + n * (4 + 7 - 1) - 1
        others = " and ".join(f"{total[op]} {op}" for op in ("sincos", "exp", "rise") if total[op])
        return f"Operations in a free phase of degree M: {fixed} + {6 * n + 4} M" + (f", {others}." if others else ".")

    def _routine(self, function: SymbolicFunction) -> Routine:
        """A function like c_code.call, with struct arguments; inline, so that the motion stays in registers."""
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
        """C that exports the inner functions of a step, for verification."""
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

    def document(self) -> dict[str, object]:
        """controller.json, from which the structs are filled. Unknown values are null."""
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
            **({} if self.monitor is None else {"monitor": self.monitor.document()}),
            **({} if self.statistics is None else {"statistics": self.statistics.document()}),
            "effects": {symbol.name: value for symbol, value in values},
            "compensated": [str(site) for site in c.compensated],
            "uncompensated": [{"effect": str(site), "reason": site.obstacle} for site in c.uncompensated],
            "operations": {f.name: Tape.of(f).count() for f in c.functions},
        }


def _brought(found: Compensation) -> dict[sp.Symbol, str]:
    """Spelling of the parameters of a trajectory's springs and contact."""
    spelling = {
        symbol: f"contact->{site.effect.name}_{p.name}"
        for site in found.touched
        for symbol, p in zip(site.symbols, site.effect.parameters, strict=True)
    }
    for spring in found.springs:
        names = zip(spring.symbols, spring.names, strict=True)
        spelling |= {symbol: f"springs[{spring.joint - 1}].{name}" for symbol, name in names}
    return spelling


def _others(found: Compensation) -> dict[str, object]:
    others = [spring for spring in found.springs if spring.joint == 1 and not spring.usual]
    fields = {s.effect.name: {n: p.name for n, (p, _) in zip(s.names, s.lumps, strict=True)} for s in others}
    return {"other_springs": fields} if fields else {}


def _powers(spring: Spring, product: sp.Expr) -> dict[str, int]:
    powers = product.as_powers_dict()
    return {p.name: int(powers[p.symbol]) for p in spring.effect.parameters if p.symbol in powers}

"""The monitor of an arm's model: its structs, its numbers, and the holes of its templates."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from math import exp, pi

import sympy as sp

from codegen.c.c_code import F32, assign, comment, indent
from codegen.c.records import Record, RecordField
from codegen.monitor.alarm import Alarm, alarm, degrees_of_freedom
from codegen.monitor.settings import (
    ADVANTAGE,
    CHANCE,
    KEEPING,
    LEAST_SHARE,
    LEVELS,
    MEMORY,
    MIDDLE,
    STEPS_A_LEVEL,
    WINDOW,
)
from codegen.tape.printers import Printer
from codegen.tape.tape import Tape
from symbolic.controller_law import Site
from symbolic.described import declared
from symbolic.effects.declaration import SIGNAL, Effect
from symbolic.functions import Coordinates
from symbolic.model import ArmModel
from symbolic.model_file.arm import ArmMonitor, Control, JointMonitor

VERDICTS = {"holds": 0, "drifts": 1, "broken": 2}
"""What the monitor says of a joint's model, as C states it."""
SIGNALS = {"none": 0, "velocity": 1, "position": 2, "acceleration": 3, "load": 4}
"""What the residual follows."""
_QD, _WARMTH = SIGNAL["qd"].symbol, SIGNAL["warmth"].symbol
_MEASURED = {s.symbol: sp.S.Zero for s in SIGNAL.values() if s.needs == "temperature" and s.switch}
"""Signals that say that no temperature is measured, in a law for where it is."""


@dataclass(frozen=True)
class ModelMonitor:
    """The monitor of an arm. alarms: one a joint; heat: what effects add for a measured warmth, in _QD and _WARMTH"""

    model: ArmModel
    settings: ArmMonitor
    control: Control
    alarms: tuple[Alarm, ...]
    heat: Mapping[Site, sp.Expr]

    @classmethod
    def of(cls, model: ArmModel, library: Mapping[str, Effect]) -> ModelMonitor | None:
        """The monitor that a model file asks for; None where it asks for none. library: all effects by name."""
        settings, control = model.arm.monitor, model.arm.controller
        if settings is None or control is None:
            return None
        free = degrees_of_freedom(settings.cutoff)
        alarms = tuple(
            alarm(joint.freedom or free, settings.false_alarms, len(settings.joints)) for joint in settings.joints
        )
        active = [(n, name, v) for n, j in enumerate(model.arm.joints, 1) for name, v in j.effects.items()]
        heat = {Site(e, n): x for n, name, v in active if (x := _heated(e := declared(name, library), v)) is not None}
        return cls(model, settings, control, alarms, heat)

    @property
    def records(self) -> tuple[Record, ...]:
        """Its structs in order of declaration; they stand in the monitor's own header."""
        name, n = self.model.arm.name, len(self.alarms)
        unit = Coordinates(tuple(joint.type for joint in self.model.arm.joints)).unit
        force, rate, signals = unit("N m", "N"), unit("rad/s", "m/s"), len(SIGNALS) - 1
        watch = (
            RecordField("floor", "float", force, "RMS of the residual in its band while the model holds"),
            RecordField("load_floor", "float", "1", "what that has more for each unit of the magnitude of the load"),
            RecordField("slowest", "float", rate, "at a lower speed the joint is not judged"),
            RecordField("reference", "uint32_t", "steps", "of the sum that tells drift"),
            RecordField("broken_reference", "uint32_t", "steps", "of the sum that tells a broken model"),
            RecordField("alarm", "uint32_t", "steps", "at which a sum is an alarm"),
        )
        config = (
            RecordField("joints", f"{name}_watch_f32", "", "what each joint is compared with", count=n),
            RecordField("gain", "float", "1", "of the low-pass on the residual: 1 - exp(-2 pi cut-off/rate)"),
            RecordField("middle", "float", "1", "of that on position and load, for the middle of their motion"),
            RecordField("window", "uint32_t", "looks", "at a joint, whose energies are judged together"),
        )
        joint = (
            RecordField("once", "float", force, "residual behind one low-pass"),
            RecordField("band", "float", force, "and behind both"),
            RecordField("begun", "uint32_t", "", "1: the joint has moved"),
            RecordField("middle_position", "float", unit("rad", "m"), "of the motion"),
            RecordField("middle_load", "float", force, "of the motion"),
            RecordField("looks", "uint32_t", "", "in this window"),
            RecordField("energy", "float", "", "squares of the residual in this window"),
            RecordField("expected", "float", "", "squares of its floor in this window"),
            RecordField("total", "float", "", "squares of the residual in the last windows"),
            RecordField("normal", "float", "", "squares of its floor in the last windows"),
            RecordField("along", "float", "", "products of residual and signals in the last windows", count=signals),
            RecordField("square", "float", "", "squares of the signals in the last windows", count=signals),
            RecordField("drifting", "uint32_t", "steps", "the sum that tells drift"),
            RecordField("breaking", "uint32_t", "steps", "the sum that tells a broken model"),
            RecordField("verdict", "uint32_t", "", f"{name.upper()}_MODEL_HOLDS, _DRIFTS or _BROKEN"),
            RecordField("signal", "uint32_t", "", f"which the residual follows: {name.upper()}_FOLLOWS_…"),
        )
        state = (
            RecordField("joints", f"{name}_watched_f32", "", "what is known of each", count=n),
            RecordField("turn", "uint32_t", "", "the joint that is looked at next, from 0"),
        )
        rows = (
            ("watch", "What a joint's residual is compared with.", watch),
            ("monitor_config", "Of the monitor; {}_monitor_default_f32 fills it from the model file.", config),
            ("watched", "What the monitor knows of a joint.", joint),
            ("monitor_state", "What the monitor keeps between two steps.", state),
        )
        return tuple(
            Record(f"{name}_{short}_f32", meaning.format(name), fields, declared=True)
            for short, meaning, fields in rows
        )

    @property
    def holes(self) -> dict[str, object]:
        """The holes of header and source."""
        name, n = self.model.arm.name, len(self.alarms)
        literal, rate = F32.language.literal, self.control.rate
        first, last = LEVELS
        return {
            "name": name,
            "NAME": name.upper(),
            "n": n,
            "guard": f"TENDON_{name.upper()}_MONITOR_F32_H",
            "types": [record.typedef() for record in self.records],
            "verdicts": {word.upper(): number for word, number in VERDICTS.items()},
            "signals": {word.upper(): number for word, number in SIGNALS.items()},
            "forgotten": [_zero(field) for field in self.records[2].fields],
            "watches": [self._watch(j, a) for j, a in zip(self.settings.joints, self.alarms, strict=True)],
            "gain": literal(Fraction(1 - exp(-2 * pi * self.settings.cutoff / rate))),
            "middle": literal(Fraction(1 - exp(-n / (rate * MIDDLE)))),
            "window": max(1, round(WINDOW * rate / n)),
            "levels": last - first,
            "lowest": literal(Fraction(2.0 ** (first / 2))),
            "half_octave": literal(Fraction(2.0**0.5)),
            "steps": STEPS_A_LEVEL,
            "kept": literal(Fraction(1 - 1 / MEMORY)),
            "steps_to_keep": round(KEEPING * STEPS_A_LEVEL),
            "least_share": literal(Fraction(LEAST_SHARE)),
            "chance": literal(Fraction(CHANCE)),
            "advantage": literal(Fraction(ADVANTAGE)),
            "promise": comment(
                f"False alarms: at most {self.settings.false_alarms:g} in a thousand hours of motion, of all joints, "
                "where the residual of a model that holds has its floor, and the degrees of freedom of the model file."
            ),
            "thermal": self._thermal(),
            "thermal_sites": ", ".join(map(str, self.heat)),
        }

    def _watch(self, joint: JointMonitor, found: Alarm) -> str:
        literal = F32.language.literal
        reals = (literal(Fraction(x)) for x in (joint.floor, joint.load_floor, joint.slowest))
        return ", ".join([*reals, *(f"{x}U" for x in (found.reference, found.broken_reference, found.level))])

    def _thermal(self) -> str:
        """Statements for `heated`, the torques of effects that read a measured temperature; empty without one."""
        if not self.heat:
            return ""
        leaves: dict[sp.Symbol, str] = {}
        torques: list[sp.Expr] = [sp.S.Zero] * len(self.alarms)
        for site, torque in self.heat.items():
            j = (site.joint or 1) - 1
            own = {symbol: sp.Symbol(f"{symbol.name}{j}", real=True) for symbol in (_QD, _WARMTH)}
            leaves |= {new: f"{old.name}[{j}]" for old, new in own.items()}
            torques[j] += torque.xreplace(own)
        tape = Tape.from_expressions(torques, (), leaves, where="heated")
        lines, texts = Printer(F32.language, tape, leaves, frozenset({"qd", "warmth", "heated"})).print()
        return indent(lines + assign([f"heated[{j}]" for j in range(len(torques))], texts), 1)

    def document(self) -> dict[str, object]:
        """Of controller.json: what the board's monitor promises, and the words for its numbers."""
        return {
            "cutoff": self.settings.cutoff,
            "window": WINDOW,
            "freedom": degrees_of_freedom(self.settings.cutoff),
            "false_alarms": self.settings.false_alarms,
            "alarms": [vars(found) for found in self.alarms],
            "verdicts": VERDICTS,
            "signals": SIGNALS,
        }


def _heated(effect: Effect, values: Mapping[str, float]) -> sp.Expr | None:
    """The torque of an effect with its values where the warmth is measured, in _QD and _WARMTH; None of another one."""
    known = {p.symbol: sp.Float(values[p.name]) for p in effect.parameters if p.name in values}
    torque = sp.sympify(effect.torque).xreplace({**_MEASURED, **known})
    others = {s.symbol for s in SIGNAL.values()} - {_QD, _WARMTH} | {p.symbol for p in effect.parameters}
    return torque if _WARMTH in torque.free_symbols and not torque.free_symbols & others else None


def _zero(field: RecordField) -> str:
    zero = "0.0f" if field.type == "float" else "0U"
    if field.count is None:
        return f"own->{field.name} = {zero};"
    return " ".join(f"own->{field.name}[{k}] = {zero};" for k in range(field.count))

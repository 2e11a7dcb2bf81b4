"""An arm's model: everything that is generated from it, derived once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction

import sympy as sp

from symbolic import contact
from symbolic.functions import Struct, SymbolicFunction
from symbolic.model_file.arm import Arm, Joint
from symbolic.model_file.checks import ModelError, nearest
from symbolic.rigid_body import dynamics, kinematics
from symbolic.rigid_body.base_parameters import base_parameters
from symbolic.rigid_body.exact_rank import BaseParameters, Column, exact
from symbolic.rigid_body.kinematics import Author, Coordinates
from symbolic.rigid_body.lagrangian import rational
from symbolic.rigid_body.layout import LayoutConstant, RecursionLayout, choose_layout

ASSUMED_SHARE = sp.Rational(1, 2)
"""Of a rotor in the base parameter into which its inertia is merged, where neither file nor rigid motion tell it."""


@dataclass(frozen=True)
class Lump:
    """A base inertial parameter. unit: e.g. "kg m^2"; joint: 1-based; value: what the model file says, None where it
    leaves out a number behind it."""

    name: str
    unit: str
    meaning: str
    joint: int
    value: float | None


@dataclass(frozen=True)
class ArmModel:
    """lumps: base inertial parameters, in which tau is linear; struct "parameters": these first, then geometry."""

    arm: Arm
    lumps: tuple[Lump, ...]
    struct: Struct
    functions: tuple[SymbolicFunction, ...]

    def function(self, name: str) -> SymbolicFunction:
        return next(f for f in self.functions if f.name == name)


def derive(arm: Arm) -> ArmModel:
    """The model of an arm with everything that is generated from it.

    Raises ModelError if the arm's file holds a value for a base parameter that this arm does not have.
    """
    base = base_parameters(arm)
    layout = choose_layout(arm, base)
    lumps = named_lumps(arm, base, layout)
    symbols = {c: sp.Symbol(lump.name, real=True) for c, lump in zip(base.values, lumps, strict=True)}
    rotors = [_rotor(joint, i, base, symbols) for i, joint in enumerate(arm.joints)]
    author = Author(Coordinates(tuple(j.type for j in arm.joints)), _struct(lumps, layout.fields))
    functions = [
        *dynamics.functions(author, layout.scaled, symbols, layout.frame, rotors),
        *kinematics.functions(author, arm, layout.metric, layout.frame),
        *(contact.functions(author, layout.metric) if contact.applies(layout.metric) else ()),
    ]
    used: set[sp.Symbol] = set()
    for f in functions:
        used = used.union(*(e.free_symbols for o in f.outputs for e in o.expressions))
        used = used.union(*(e.free_symbols for _, e in f.definitions))
    struct = _struct(lumps, tuple(f for f in layout.fields if f.symbol in used))
    return ArmModel(arm, lumps, struct, tuple(replace(f, struct=struct) for f in functions))


def _rotor(joint: Joint, i: int, base: BaseParameters, symbols: Mapping[Column, sp.Symbol]) -> sp.Expr:
    """What the link side of a joint does without: the rotor's inertia as the file has it. Where it is not known, the
    base parameter that is nothing else, as joints further out have it; where none is, no rigid motion tells the rotor
    from its link, and half of what both are in is taken for it: the gear that accelerates its load best makes them
    equal (Pasch & Seering 1984, On the drive systems for high-performance machines)."""
    if joint.rotor_inertia is not None:
        return rational(joint.rotor_inertia)
    own: Column = ("I", i)
    if len(base.merged.get(own, ())) == 1:
        return symbols[own]
    shared = [c for c, parts in base.merged.items() if own in dict(parts)]
    return ASSUMED_SHARE * symbols[shared[0]] if len(shared) == 1 else sp.Integer(0)


def _struct(lumps: tuple[Lump, ...], fields: tuple[LayoutConstant, ...]) -> Struct:
    return Struct(
        "parameters",
        tuple(sp.Symbol(lump.name, real=True) for lump in lumps) + tuple(f.symbol for f in fields),
        tuple(lump.unit for lump in lumps) + tuple(f.unit for f in fields),
        tuple(lump.meaning for lump in lumps) + tuple(f.meaning for f in fields),
        (*(lump.value for lump in lumps), *(float(f.value) for f in fields)),
    )


def named_lumps(arm: Arm, base: BaseParameters, layout: RecursionLayout) -> tuple[Lump, ...]:
    """The base parameters as people see them; values that an identification left in the file replace the links'.

    Raises ModelError for a value in the file whose name this arm does not have.
    """
    scale = exact(arm.joints[layout.reference - 1].link.length) if layout.reference else Fraction(1)
    lumps = []
    for (kind, i), value in base.values.items():
        sliding = arm.joints[i].type == "prismatic"
        power = layout.metres(kind)
        name = f"{'M' if sliding and kind == 'mu' else kind}{i + 1}"
        own = {"J": "kg m^2", "I": "kg" if sliding else "kg m^2", "mu": "kg", "h": "kg m", "hy": "kg m"}[kind]
        unit = "kg m^2" if power else own
        note = f", times l{layout.reference}{'^2' if power == 2 else ''}" if power else ""
        also = ", rotor included" if kind != "I" and any(c == ("I", i) for c, _ in base.merged[kind, i]) else ""
        stated = None if value is None else float(value * scale**power)
        text = _meaning(kind, i + 1, sliding, len(arm.joints)) + also + note
        lumps.append(Lump(name, unit, text, i + 1, arm.inertial.get(name, stated)))
    names = [lump.name for lump in lumps]
    for name in arm.inertial:
        if name not in names:
            near = nearest(name, names)
            hint = f'; did you mean "{near}"?' if near else ""
            raise ModelError(
                f'{arm.name}: inertial: unknown base parameter "{name}"{hint} (this arm has {", ".join(names)})'
            )
    return tuple(lumps)


def _meaning(kind: str, joint: int, sliding: bool, n: int) -> str:
    end = "the end-effector" if joint == n else f"joint {joint + 1}"
    if kind == "mu":
        return f"mass that joint {joint} slides" if sliding else f"point mass that link {joint} carries at {end}"
    return {
        "J": f"inertia that turns with link {joint} about joint {joint}, beyond the point masses",
        "I": f"rotor inertia of joint {joint} at its output",
        "h": f"first mass moment of link {joint} along it, beyond the point masses",
        "hy": f"first mass moment of link {joint} across it, from a centre of mass off its line",
    }[kind]

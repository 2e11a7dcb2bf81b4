"""An arm's model: everything that is generated from it, derived once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import sympy as sp

from symbolic import drive_function
from symbolic.functions import Author, Coordinates, Struct, SymbolicFunction
from symbolic.model_file.arm import Arm, Joint, OpenNumber
from symbolic.rigid_body import dynamics, kinematics
from symbolic.rigid_body.base_parameters import (
    BaseParameters,
    Column,
    LayoutConstant,
    Lump,
    base_parameters,
    choose_layout,
    named_lumps,
)
from symbolic.rigid_body.kinematics import contact_functions, has_contact_phase
from symbolic.rigid_body.lagrangian import rational
from symbolic.rigid_body.spatial import base_parameters as spatial_base
from symbolic.rigid_body.spatial import composites
from symbolic.rigid_body.spatial import dynamics as spatial_dynamics
from symbolic.rigid_body.spatial import kinematics as spatial_kinematics
from symbolic.rigid_body.spatial.geometry import geometry

ASSUMED_SHARE = sp.Rational(1, 2)
"""Assumed share of an unknown rotor in the base parameter with which its inertia is merged."""


@dataclass(frozen=True)
class ArmModel:
    """An arm's functions. lumps: base inertial parameters, in which tau is linear; struct: these, then geometry.

    open   of a model of which code is made for others (codegen.open_numbers)
    """

    arm: Arm
    lumps: tuple[Lump, ...]
    struct: Struct
    functions: tuple[SymbolicFunction, ...]
    open: tuple[OpenNumber, ...] = ()

    def function(self, name: str) -> SymbolicFunction:
        """The function of this name. Raises StopIteration where the arm has none."""
        return next(f for f in self.functions if f.name == name)


def derive(arm: Arm, no_rotors: bool = False) -> ArmModel:
    """Derive an arm's model. no_rotors: a rotor that is open is taken as 0, where all links with it are known.

    Raises ModelError if the arm's file holds a value for a base parameter that this arm does not have.
    """
    return _in_space(arm, no_rotors) if arm.space else _in_the_plane(arm, no_rotors)


def _in_the_plane(arm: Arm, no_rotors: bool) -> ArmModel:
    base = base_parameters(arm)
    layout = choose_layout(arm, base)
    lumps, links = _taken(named_lumps(arm, base, layout), no_rotors)
    symbols = _symbols(base, lumps)
    rotors = [_rotor(joint, i, base, symbols, links) for i, joint in enumerate(arm.joints)]
    author = Author(Coordinates(tuple(j.type for j in arm.joints)), _struct(lumps, layout.fields))
    functions = [
        *dynamics.functions(author, layout.scaled, symbols, frame=layout.frame, rotors=rotors),
        *kinematics.functions(author, arm, layout.metric, layout.frame),
        *(contact_functions(author, layout.metric) if has_contact_phase(layout.metric) else ()),
        *drive_function.functions(author, arm),
    ]
    return _model(arm, lumps, layout.fields, functions)


def _in_space(arm: Arm, no_rotors: bool) -> ArmModel:
    g = geometry(arm)
    merged = spatial_base.merging(g)
    axes = spatial_base.choose_axes(g, merged.kept)
    base = spatial_base.base_parameters(arm, g, merged)
    lumps, links = _taken(spatial_base.named_lumps(arm, base, merged), no_rotors)
    symbols = _symbols(base, lumps)
    own = [_rotor(joint, i, base, symbols, links) for i, joint in enumerate(arm.joints)]
    angles = spatial_base.angles(g)
    author = Author(Coordinates(tuple(j.type for j in arm.joints)), _struct(lumps, angles))
    chain = g.symbolic()
    bodies, rotors = spatial_base.bodies(symbols, g.n)
    functions = [
        *spatial_dynamics.functions(author, chain, axes, symbols=symbols, own=own),
        *composites.functions(author, chain, bodies, rotors=rotors, own=own),
        spatial_dynamics.forward_dynamics(author, chain, bodies, rotors),
        *spatial_kinematics.functions(author, arm, chain),
        *drive_function.functions(author, arm),
    ]
    return _model(arm, lumps, angles, functions)


def _taken(lumps: tuple[Lump, ...], no_rotors: bool) -> tuple[tuple[Lump, ...], dict[str, float]]:
    links = {x.name: x.links for x in lumps if no_rotors and x.lacks and x.links is not None}
    return tuple(replace(x, value=links.get(x.name, x.value)) for x in lumps), links


def _symbols(base: BaseParameters, lumps: Sequence[Lump]) -> dict[Column, sp.Symbol]:
    return {c: sp.Symbol(lump.name, real=True) for c, lump in zip(base.values, lumps, strict=True)}


def _model(
    arm: Arm,
    lumps: tuple[Lump, ...],
    fields: tuple[LayoutConstant, ...],
    functions: Sequence[SymbolicFunction],
) -> ArmModel:
    """The model, whose struct has only the constants that are used."""
    used: set[sp.Symbol] = set()
    for f in functions:
        used = used.union(*(e.free_symbols for o in f.outputs for e in o.expressions))
        used = used.union(*(e.free_symbols for _, e in f.definitions))
    struct = _struct(lumps, tuple(f for f in fields if f.symbol in used))
    return ArmModel(arm, lumps, struct, tuple(replace(f, struct=struct) for f in functions))


def _rotor(
    joint: Joint, i: int, base: BaseParameters, symbols: Mapping[Column, sp.Symbol], links: Mapping[str, float]
) -> sp.Expr:
    """A rotor's inertia: from the file, else the base parameter that consists of it alone. If there is none, rigid
    motion cannot separate the rotor from its link, and half of their common base parameter is assumed, because the gear
    ratio of fastest acceleration makes both equal (Pasch & Seering 1984, On the drive systems for high-performance
    machines). links: values by name of base parameters whose rotor was taken as 0; what exceeds them is the rotor."""
    if joint.rotor_inertia is not None:
        return rational(joint.rotor_inertia)
    own: Column = ("I", i)
    if len(base.merged.get(own, ())) == 1:
        return symbols[own]
    shared = [c for c, parts in base.merged.items() if own in dict(parts)]
    if len(shared) != 1:
        return sp.Integer(0)
    common = symbols[shared[0]]
    return common - rational(links[common.name]) if common.name in links else ASSUMED_SHARE * common


def _struct(lumps: tuple[Lump, ...], fields: tuple[LayoutConstant, ...]) -> Struct:
    return Struct(
        "parameters",
        tuple(sp.Symbol(lump.name, real=True) for lump in lumps) + tuple(f.symbol for f in fields),
        tuple(lump.unit for lump in lumps) + tuple(f.unit for f in fields),
        meanings=tuple(lump.meaning for lump in lumps) + tuple(f.meaning for f in fields),
        defaults=(*(lump.value for lump in lumps), *(float(f.value) for f in fields)),
    )

"""What a model file leaves open, and whether code is made for others all the same: one rule for every target.

An open rotor is taken as 0, so that the links count, and so is an open number in which an effect is linear. Where a
number of a link is open, or D is not positive definite, code is made only if it is asked for. What has no value is then
NaN in C, C++ and Rust; Python and CasADi ask for it.
"""

from __future__ import annotations

import random
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from math import pi

import numpy as np

from codegen.tape.tape import Tape
from symbolic.controller_law import Site, active
from symbolic.effects.declaration import Effect, Parameter
from symbolic.model import ArmModel, derive
from symbolic.model_file.arm import Arm, OpenNumber
from symbolic.model_file.checks import ModelError, check_stated, open_lines

POSES = 1000
"""Random poses at which D is looked at, within the joints' limits or half a turn (1 m) to both sides."""
FARTHEST = 100.0
"""rad or m; poses beyond are none of an arm, and rounding would decide of them."""
LEAST_EIGENVALUE = 1e-12
"""Of D with a diagonal of 1, where it counts as positive definite: thousands of roundings."""


def for_others(arm: Arm, library: Mapping[str, Effect], even_open: bool = False) -> ArmModel:
    """The model of an arm of which code is made, with what its file leaves open.

    library     all effects by name
    even_open   also where a number of a link is open or D is not positive definite
    Raises ModelError that names what is open.
    """
    model = derive(arm, no_rotors=True)
    numbers = tuple(_open(model, library))
    if not even_open:
        anyway = "take the code as it is: tendon generate --open"
        check_stated(arm.name, *open_links(model), anyway)
        if (pose := _indefinite(model)) is not None:
            said = [f"{arm.name}: {pose}", *open_lines(numbers), "state what is open or correct the links' numbers"]
            raise ModelError(f"{'; '.join(said)}, or {anyway}")
    return replace(model, open=numbers)


def open_links(model: ArmModel) -> tuple[list[str], list[Sequence[str]]]:
    """The base parameters without a value, and the keys that the file leaves out, by joint: for check_stated."""
    return [lump.name for lump in model.lumps if lump.value is None], [joint.unknown for joint in model.arm.joints]


def open_values(model: ArmModel, library: Mapping[str, Effect]) -> list[tuple[Site, Parameter]]:
    """The parameters of the arm's effects to which the file gives no value."""
    stated = [(site, p, values) for site, values in active(model, library) for p in site.effect.parameters]
    return [(site, p) for site, p, values in stated if values.get(p.name, p.default) is None]


def _open(model: ArmModel, library: Mapping[str, Effect]) -> Iterator[OpenNumber]:
    """Of rotors and links, joint by joint, then of effects."""
    hanging = sorted((place, lump.value is None) for lump in model.lumps for place in lump.lacks)
    for (joint, key), without in dict(hanging).items():
        yield OpenNumber(joint, key, None if without else 0.0)
    for site, p in open_values(model, library):
        yield OpenNumber(site.joint, f"{site.effect.name}.{p.name}", 0.0 if p.role == "linear" else None)


def _indefinite(model: ArmModel) -> str | None:
    """At how many random poses D is not positive definite, and the first of them; None: at none."""
    rng, function, n = random.Random(0), model.function("inertia"), len(model.arm.joints)
    free = {"revolute": (-pi, pi), "prismatic": (-1.0, 1.0)}
    ranges = [joint.limits.position or free[joint.type] for joint in model.arm.joints]
    poses = np.array([[rng.uniform(*np.clip(ends, -FARTHEST, FARTHEST)) for ends in ranges] for _ in range(POSES)])
    values = dict(zip(model.struct.symbols, model.struct.defaults, strict=True))
    values |= dict(zip(function.inputs[0].symbols, poses.T, strict=True))
    elements = Tape.of(function).evaluate(values, {"const": float, "neg": np.negative, "sin": np.sin, "cos": np.cos})
    D = np.stack([np.broadcast_to(e, POSES) for e in elements], axis=-1).reshape(POSES, n, n)
    own = np.diagonal(D, axis1=1, axis2=2)
    scale = 1.0 / np.sqrt(np.where(own > 0.0, own, 1.0))
    wrong = np.linalg.eigvalsh(D * scale[:, :, None] * scale[:, None, :])[:, 0] <= LEAST_EIGENVALUE
    if not wrong.any():
        return None
    pose = ", ".join(f"{x:.3g}" for x in poses[wrong.argmax()])
    return f"D is not positive definite in {wrong.sum()} of {POSES} random poses, first at q = [{pose}]"

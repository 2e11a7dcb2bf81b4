"""URDF or MJCF to model file: stated values are kept, missing ones are unknown."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from symbolic.described import AnyEffect
from symbolic.model_file import model_text
from symbolic.model_file.arm import Arm, Joint, Limits, Link, Values
from symbolic.model_file.checks import MAX_LABEL, MAX_NAME, ModelError, Place, identifier, is_taken
from symbolic.model_file.exchange import urdf, xml_file
from symbolic.model_file.exchange.exporting import DOWN
from symbolic.model_file.exchange.tree import (
    Tree,
    TreeChain,
    chain,
    gears_of,
    joints_of,
    label_of,
    shortened,
    some,
)
from symbolic.model_file.frames import applied, listed, transposed
from symbolic.model_file.reader import parse


@dataclass(frozen=True)
class ImportedArm:
    """An imported arm. text: the model file; arm: its content; notes: warnings, a line each."""

    text: str
    arm: Arm
    chain: TreeChain
    notes: tuple[str, ...]


def imported(
    path: Path,
    library: Mapping[str, AnyEffect],
    base: str | None = None,
    tip: str | None = None,
    locked: Mapping[str, float] | None = None,
    friction: bool = True,
) -> ImportedArm:
    """The arm from one link to another of a URDF or MJCF file.

    library    the effects by name
    base, tip  links; None: the root, and the only end     locked   joint -> fixed position, rad or m
    friction   add the effects that every joint is assumed to have, with unknown values where the file states none
    Raises ModelError: one line that names the file and what to pass instead.
    """
    tree = read_tree(path)
    found = chain(tree, base, tip, locked or {})
    notes = [*tree.notes, *found.notes]
    effects = _effects(found, library, friction, notes)
    doubtful = _placeholders(found, friction)
    notes += doubtful
    arm = _arm(found, path, effects, notes)
    gears = [
        ""
        if joint.gear is not None
        else f"unknown: the file states different ones ({gears_of(joint)})"
        if joint.gears
        else "not stated"
        for joint in (one.joint for one in found.joints)
    ]
    gravity = (
        "m/s^2" if tree.gravity is not None else f"m/s^2; not stated: z of {shortened(found.root)} is taken to point up"
    )
    ends = f"{shortened(tree.name or path.stem)}, {shortened(found.base)} to {shortened(found.tip_link)}"
    head = [
        f"{ends}: made by tendon import from {shortened(path.name)} ({tree.language}).",
        "Values that it does not state are unknown: tendon identify MODEL RECORDING --write identifies them.",
    ]
    text = model_text.text(arm, [*head, *doubtful], gravity, gears)
    made = parse(text, path.name, library)
    assert made.space
    return ImportedArm(text, made, found, (*notes, *made.notes))


def read_tree(path: Path) -> Tree:
    """The links and joints of a file, whose format is recognised by its content. Raises ModelError."""
    root = xml_file.read(path)
    if root.tag == "robot":
        return urdf.urdf_tree(root)
    if root.tag == "mujoco":
        from symbolic.model_file.exchange import mjcf

        return mjcf.mjcf_tree(path, root)
    return root.fail(f"its root is <{root.tag}>; expected <robot> (URDF) or <mujoco> (MJCF)")


# --- the arm ---


def _arm(found: TreeChain, path: Path, effects: Sequence[dict[str, Values]], notes: list[str]) -> Arm:
    names = unique(label_of(joint.joint.name) for joint in found.joints)
    joints = []
    for joint, name, active in zip(found.joints, names, effects, strict=True):
        stated, body = joint.joint, joint.body
        link = Link() if body is None else Link(body.mass, body.com, None if joint.doubt else body.inertia)
        joints.append(
            Joint(
                type=joint.type,
                rotor_inertia=stated.rotor,
                gear_ratio=1.0 if stated.gear is None else stated.gear,
                limits=Limits(stated.position, stated.speed, stated.torque),
                effects=active,
                name=name,
                axis=stated.axis,
                origin=joint.origin,
                link=link,
            )
        )
    notes += _left_out(found)
    gravity = applied(transposed(found.mounting), DOWN if found.tree.gravity is None else found.tree.gravity)
    return Arm(arm_name(found.tree.name, path), gravity, tuple(joints), tip=found.tip)


def _left_out(found: TreeChain) -> list[str]:
    """Notes on values that the file does not state or that were rejected."""
    doubts = [f"joint {k}: {doubt}" for k, joint in enumerate(found.joints, 1) for doubt in joint.joint.doubts]
    notes = [f"{doubt}: left out, hence unknown" for doubt in (*doubts, *(j.doubt for j in found.joints if j.doubt))]
    if found.held:
        notes.append(
            f"{some(found.held)} {'is' if len(found.held) == 1 else 'are'} not between base and tip: locked at 0, with "
            "the links attached there (--lock JOINT=VALUE for another position)"
        )
    for what, missing in (
        ("mass, centre and inertia", [joint.body is None for joint in found.joints]),
        ("the rotor's inertia", [joint.joint.rotor is None for joint in found.joints]),
    ):
        if any(missing):
            notes.append(f"{what} of {joints_of(missing)}: not stated, hence unknown")
    for k, joint in enumerate(found.joints, 1):
        if joint.joint.gears and joint.joint.gear is None:
            notes.append(
                f"gear_ratio of joint {k}: the file states different ones ({gears_of(joint.joint)}): set to 1; ripple, "
                "encoders and currents need the true one"
            )
    gearless = [joint.joint.gear == 1.0 or not joint.joint.gears for joint in found.joints]
    if any(gearless):
        notes.append(
            f"gear_ratio of {joints_of(gearless)}: not stated, set to 1; ripple, encoders and "
            "currents need the true one"
        )
    return notes


# --- friction and springs ---


def _effects(
    found: TreeChain, library: Mapping[str, AnyEffect], friction: bool, notes: list[str]
) -> list[dict[str, Values]]:
    """The effects of every joint; values that the file does not state are unknown."""
    assumed = [effect for effect in library.values() if effect.assumed and friction]
    made: list[dict[str, Values]] = []
    for k, joint in enumerate(found.joints, 1):
        stated = {word: value for word, value in joint.joint.dynamics.items() if word not in SIZES or value > 0}
        wrong = [f"{word} = {value:g}" for word, value in joint.joint.dynamics.items() if word not in stated]
        if wrong:
            notes.append(f"{listed(wrong)} of joint {k}: left out, hence unknown; expected a number above 0")
        springs = {}
        if stated.get(STIFFNESS):
            spring = next(e for e in library.values() if any(p.abroad == STIFFNESS for p in e.parameters))
            springs = {spring.name: {p.name: stated.get(p.abroad, 0.0) for p in spring.parameters}}
        # Beside a spring, friction that differs by direction is a constant, which motion cannot separate from the
        # spring's rest position: its symmetric special case is taken.
        even = [next((library[name] for name in e.generalises if name in library), e) for e in assumed]
        here = even if springs else assumed
        known = {e.name: {p.name: stated[p.abroad] for p in e.parameters if p.abroad in stated} for e in here}
        made.append({**known, **springs})
    return made


STIFFNESS = "stiffness"
"""MJCF's word for the stiffness of a joint's spring."""
SIZES = ("damping", "friction", STIFFNESS)
"""Words whose values cannot be negative."""


def _placeholders(found: TreeChain, friction: bool) -> list[str]:
    """A note on values that look like placeholders; they are used as stated."""
    typed = (*(("friction", "damping") if friction else ()), "rotor_inertia")
    seen: dict[str, list[bool]] = {}
    tree_joints = [one.joint for one in found.joints]
    stated_of = [{"speed": j.speed, "torque": j.torque, "rotor_inertia": j.rotor, **j.dynamics} for j in tree_joints]
    for kind in ("revolute", "prismatic"):
        here = [joint.type == kind for joint in found.joints]
        for word in (*typed, "speed", "torque"):
            stated = [
                max(values.get(word) or 0.0, 0.0) if own else 0.0 for values, own in zip(stated_of, here, strict=True)
            ]
            # Equal drives have equal limits, but several joints hardly share a power of ten by chance.
            if is_placeholder(stated) if word in typed else is_round(stated) and sum(map(bool, stated)) > 1:
                which = seen.setdefault(f"{word} = {max(stated):g}", [False] * len(stated))
                which[:] = [one or value > 0 for one, value in zip(which, stated, strict=True)]
    if not seen:
        return []
    places: dict[str, list[str]] = {}
    for what, which in seen.items():
        places.setdefault(joints_of(which), []).append(what)
    said = "; ".join(f"{listed(numbers)} at {where}" for where, numbers in places.items())
    return [f"{said}: looks like a placeholder, used as stated; delete it if it was not measured: it is then unknown"]


def is_placeholder(stated: Sequence[float]) -> bool:
    """Whether the values look like placeholders: all nonzero ones are equal, or a single one is a power of ten."""
    values = {value for value in stated if value}
    return len(values) == 1 and (sum(map(bool, stated)) > 1 or is_round(stated))


def is_round(stated: Sequence[float]) -> bool:
    """Whether all nonzero values are the same power of ten."""
    values = {value for value in stated if value}
    if len(values) != 1:
        return False
    power = math.log10(values.pop())
    return abs(power - round(power)) < 1e-9


# --- names ---


def arm_name(name: str, path: Path) -> str:
    """A C identifier made from the robot's name or else the file's."""
    for wanted in (name, path.stem, "arm"):
        made = re.sub(r"[^A-Za-z0-9]+", "_", wanted).strip("_")[:MAX_NAME].rstrip("_")
        for candidate in (made, f"arm_{made}"[:MAX_NAME]):
            with suppress(ModelError):
                if made and not is_taken(identifier(Place(""), "name", candidate)):
                    return candidate
    raise AssertionError("arm is a name")


def unique(names: Iterable[str]) -> list[str]:
    """The names, with numbers added where they are equal."""
    made: list[str] = []
    for name in names:
        wanted, k = name, 1
        while wanted in made:
            k += 1
            wanted = f"{name[: MAX_LABEL - 4]}_{k}"
        made.append(wanted)
    return made

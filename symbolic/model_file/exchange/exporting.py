"""An arm written as URDF or MJCF: what these formats can express of it, and a list of what they cannot."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import fmean
from typing import TYPE_CHECKING, Literal
from xml.sax.saxutils import quoteattr

from symbolic.model_file.arm import Arm, Frame, Joint, Values
from symbolic.model_file.exchange.tree import FREE, joints_of
from symbolic.model_file.frames import StatedBody, scaled

if TYPE_CHECKING:
    from symbolic.effects.declaration import Effect

Language = Literal["urdf", "mjcf"]
WORDS: Mapping[Language, tuple[str, ...]] = {
    "urdf": ("damping", "friction"),
    "mjcf": ("damping", "friction", "stiffness", "rest", "lag"),
}
"""The words of each format for a joint's effects; see DescribedParameter.abroad."""
GRAVITY = ("gravity x", "gravity y", "gravity z")
"""Words of parameters that add to the model's gravity, along the base axes."""
DOWN = (0.0, 0.0, -9.81)
"""m/s²; gravity where a file states none, as programs assume it: URDF's z axis points up by convention (REP 103)."""
ROUNDING = 1e-12
"""Relative to a body's size or inertia: smaller values are rounding errors of the search for possible bodies."""


@dataclass(frozen=True)
class ExportedJoint:
    """A joint to be written. dynamics: values by the format's words; unknown: words whose values are unknown."""

    name: str
    joint: Joint
    body: StatedBody
    rotor: float
    dynamics: Mapping[str, float]
    unknown: frozenset[str] = frozenset()


@dataclass(frozen=True)
class ExportedArm:
    """An arm to be written. unsaid: what the format cannot express or the model does not know, an item each."""

    arm: Arm
    joints: tuple[ExportedJoint, ...]
    unsaid: tuple[str, ...]


Unsaid = dict[tuple[str, str], set[int]]
"""Effects that a file cannot express, and why or how not -> the joints, from 1."""


def exported(
    arm: Arm,
    library: Mapping[str, Effect],
    language: Language,
    bodies: Sequence[StatedBody],
    rotors: Sequence[float],
) -> ExportedArm:
    """The arm with complete bodies and the effects that the format can express.

    bodies   possible bodies, in their joints' frames     rotors   inertias at the output
    """
    missing: Unsaid = {}
    joints = []
    alike = {name: values for name, values in arm.effects.items() if _at_joints(name, library)}
    for k, (joint, body, rotor) in enumerate(zip(arm.joints, bodies, rotors, strict=True), 1):
        said, unknown = _dynamics({**joint.effects, **alike}, library, language, joint=k, unsaid=missing)
        joints.append(
            ExportedJoint(joint.name or f"joint{k}", joint, body, rotor=rotor, dynamics=said, unknown=unknown)
        )
    made, of_arm = _with_gravity(arm, library)
    all_joints = range(1, len(arm.joints) + 1)
    lacking = ((effect, how, [k in there for k in all_joints]) for (effect, how), there in missing.items())
    unsaid = [*(f"{effect} at {joints_of(which)}{how}" for effect, how, which in lacking), *of_arm]
    if arm.contact is not None:
        unsaid.append("the contact with a plate")
    stated: dict[str, list[bool]] = {
        "torque_constant": [joint.torque_constant is not None for joint in arm.joints],
        "encoder": [joint.encoder_counts is not None for joint in arm.joints],
        "controller": [joint.gains is not None for joint in arm.joints],
        "drive": [joint.drive is not None for joint in arm.joints],
        "limits.speed": [language == "mjcf" and joint.limits.speed is not None for joint in arm.joints],
        "rotor_inertia": [language == "urdf" and bool(rotor) for rotor in rotors],
    }
    unsaid += [f"{key} of {joints_of(which)}" for key, which in stated.items() if any(which)]
    if language == "urdf" and made.gravity != DOWN:
        unsaid.append(f"gravity {list(made.gravity)}: loaders take {list(DOWN)}")
    return ExportedArm(made, tuple(joints), tuple(unsaid))


def _at_joints(name: str, library: Mapping[str, Effect]) -> bool:
    """Whether an effect of the arm is one of every joint, with the same values."""
    return name in library and bool(library[name].alike_at_joints)


def _with_gravity(arm: Arm, library: Mapping[str, Effect]) -> tuple[Arm, list[str]]:
    """The arm with its gravity effects added to gravity, and a list of its other or unknown effects."""
    gravity, unsaid = list(arm.gravity), []
    for name, values in arm.effects.items():
        if _at_joints(name, library):
            continue
        own = [p for p in library[name].parameters if arm.space or not p.space] if name in library else []
        if not own or any(p.abroad not in GRAVITY for p in own):
            unsaid.append(f"{name} of the arm")
        elif any(p.name not in values for p in own):
            unsaid.append(f"{name} of the arm: its values are not known")
        else:
            for p in own:
                gravity[GRAVITY.index(p.abroad)] += values[p.name]
    x, y, z = gravity
    return replace(arm, gravity=(x, y, z)), unsaid


def _dynamics(
    effects: Mapping[str, Values], library: Mapping[str, Effect], language: Language, joint: int, unsaid: Unsaid
) -> tuple[dict[str, float], frozenset[str]]:
    """A joint's effects by the format's words, and the words whose values are unknown; the rest goes into `unsaid`."""
    said: dict[str, float] = {}
    unknown: set[str] = set()
    for name, values in effects.items():
        words = {p.name: p.abroad for p in library[name].parameters} if name in library else {}
        if not words or not set(words.values()) <= set(WORDS[language]):
            unsaid.setdefault((name, ""), set()).add(joint)
            continue
        if not words.keys() <= values.keys():
            unsaid.setdefault((name, ": its values are not known"), set()).add(joint)
            unknown |= set(words.values())
            continue
        for word in dict.fromkeys(words.values()):
            stated = [values[key] for key, other in words.items() if other == word]
            said[word] = said.get(word, 0.0) + fmean(stated)
            if len(set(stated)) > 1:
                how = " in each direction: the mean of both is written"
                unsaid.setdefault((name, how), set()).add(joint)
    return said, frozenset(unknown - said.keys())


# --- bodies ---


def body_of(values: Sequence[float]) -> StatedBody:
    """The body with these ten inertial parameters; rounding errors of zeros are removed."""
    m, x, y, z, xx, xy, xz, yy, yz, zz = map(float, values)
    x, y, z = x / m, y / m, z / m
    inertia = (
        xx - m * (y * y + z * z),
        xy + m * x * y,
        xz + m * x * z,
        yy - m * (x * x + z * z),
        yz + m * y * z,
        zz - m * (x * x + y * y),
    )
    spread = inertia[0] + inertia[3] + inertia[5]
    x, y, z = _without_rounding((x, y, z), math.sqrt(spread / m))
    xx, xy, xz, yy, yz, zz = _without_rounding(inertia, spread)
    return StatedBody(m, (x, y, z), (xx, xy, xz, yy, yz, zz))


def _without_rounding(values: Sequence[float], size: float) -> tuple[float, ...]:
    return tuple(0.0 if abs(value) < ROUNDING * size else value for value in values)


DIGITS_OF_DOUBLE = 15
"""Significant digits that a double certainly has, so that the torques equal the model's."""
BASE, TIP = "base", "tip"


def urdf_text(made: ExportedArm) -> str:
    """The text of a URDF. Unknown limits of effort and speed are FREE."""
    lines = ['<?xml version="1.0"?>', *_about(made), f"<robot name={quoteattr(made.arm.name)}>"]
    lines.append(f'  <link name="{BASE}"/>')
    parent = BASE
    for joint in made.joints:
        child = f"{joint.name}_link"
        lines += _urdf_joint(joint, parent, child)
        lines += [f"  <link name={quoteattr(child)}>", *inertial(joint.body, "    "), "  </link>"]
        parent = child
    lines += [f'  <link name="{TIP}"/>', f'  <joint name="{TIP}_joint" type="fixed">']
    lines += [*_between(parent, TIP), f"    {_origin(made.arm.tip)}", "  </joint>"]
    for joint in made.joints:
        if joint.joint.gear_ratio != 1:
            lines += [
                f"  <transmission name={quoteattr(f'{joint.name} transmission')}>",
                "    <type>transmission_interface/SimpleTransmission</type>",
                f"    <joint name={quoteattr(joint.name)}/>",
                f"    <actuator name={quoteattr(f'{joint.name} motor')}>",
                f"      <mechanicalReduction>{number(joint.joint.gear_ratio)}</mechanicalReduction>",
                "    </actuator>",
                "  </transmission>",
            ]
    return "\n".join([*lines, "</robot>"]) + "\n"


def _about(made: ExportedArm) -> list[str]:
    lines = [f"<!-- {made.arm.name}: written by tendon export; its bodies give the torques of the model. -->"]
    return [*lines, *(f"<!-- Not said here: {item}. -->" for item in made.unsaid)]


def number(value: float) -> str:
    """A number as text, without negative zero."""
    return f"{value + 0.0:.{DIGITS_OF_DOUBLE}g}"


def numbers(values: Sequence[float]) -> str:
    """Numbers separated by blanks."""
    return " ".join(map(number, values))


def _origin(frame: Frame) -> str:
    return f'<origin xyz="{numbers(frame.xyz)}" rpy="{numbers(frame.rpy)}"/>'


def _between(parent: str, child: str) -> list[str]:
    return [f"    <parent link={quoteattr(parent)}/>", f"    <child link={quoteattr(child)}/>"]


def _unit(joint: ExportedJoint) -> tuple[float, float, float]:
    return scaled(1 / math.hypot(*joint.joint.axis), joint.joint.axis)


def inertial(body: StatedBody, indent: str) -> list[str]:
    """<inertial> of a link."""
    xx, xy, xz, yy, yz, zz = map(number, body.inertia)
    return [
        f"{indent}<inertial>",
        f'{indent}  <origin xyz="{numbers(body.com)}" rpy="0 0 0"/>',
        f'{indent}  <mass value="{number(body.mass)}"/>',
        f'{indent}  <inertia ixx="{xx}" ixy="{xy}" ixz="{xz}" iyy="{yy}" iyz="{yz}" izz="{zz}"/>',
        f"{indent}</inertial>",
    ]


def _urdf_joint(joint: ExportedJoint, parent: str, child: str) -> Iterator[str]:
    limits = joint.joint.limits
    kind = "continuous" if joint.joint.type == "revolute" and limits.position is None else joint.joint.type
    yield f'  <joint name={quoteattr(joint.name)} type="{kind}">'
    yield from _between(parent, child)
    yield f"    {_origin(joint.joint.origin)}"
    yield f'    <axis xyz="{numbers(_unit(joint))}"/>'
    low, high = limits.position or (-FREE, FREE)
    place = "" if kind == "continuous" else f'lower="{number(low)}" upper="{number(high)}" '
    yield f'    <limit {place}effort="{number(limits.torque or FREE)}" velocity="{number(limits.speed or FREE)}"/>'
    damping, friction = (number(joint.dynamics.get(word, 0.0)) for word in WORDS["urdf"])
    yield f'    <dynamics damping="{damping}" friction="{friction}"/>'
    yield "  </joint>"


# --- MJCF ---


def mjcf_text(made: ExportedArm) -> str:
    """The text of an MJCF: armature is the rotor's inertia, a motor's gear the gear ratio."""
    lines = [*_about(made), f"<mujoco model={quoteattr(made.arm.name)}>"]
    lines += ['  <compiler angle="radian" eulerseq="XYZ" autolimits="true"/>']
    lines += [f'  <option gravity="{numbers(made.arm.gravity)}"/>', "  <worldbody>"]
    for depth, joint in enumerate(made.joints):
        lines += _mjcf_body(joint, "  " * (depth + 2))
    indent = "  " * (len(made.joints) + 2)
    lines.append(f'{indent}<site name="{TIP}" {_pose(made.arm.tip)}/>')
    lines += [f"{'  ' * (depth + 2)}</body>" for depth in reversed(range(len(made.joints)))]
    lines += ["  </worldbody>", "  <actuator>"]
    for joint in made.joints:
        name, lag = quoteattr(joint.name), joint.dynamics.get("lag", 0.0)
        kind, more = ("general", f' dyntype="filterexact" dynprm="{number(lag)}"') if lag else ("motor", "")
        lines.append(f'    <{kind} name={name} joint={name} gear="{number(joint.joint.gear_ratio)}"{more}/>')
    return "\n".join([*lines, "  </actuator>", "</mujoco>"]) + "\n"


def _pose(frame: Frame) -> str:
    return f'pos="{numbers(frame.xyz)}" euler="{numbers(frame.rpy)}"'


def _mjcf_body(joint: ExportedJoint, indent: str) -> Iterator[str]:
    limits, said = joint.joint.limits, joint.dynamics
    attributes = {
        "name": joint.name,
        "type": "hinge" if joint.joint.type == "revolute" else "slide",
        "axis": numbers(_unit(joint)),
        "armature": number(joint.rotor),
        "damping": number(said.get("damping", 0.0)),
        "frictionloss": number(said.get("friction", 0.0)),
    }
    if said.get("stiffness"):
        attributes |= {"stiffness": number(said["stiffness"]), "springref": number(said.get("rest", 0.0))}
    if limits.position is not None:
        attributes["range"] = numbers(limits.position)
    if limits.torque is not None:
        attributes["actuatorfrcrange"] = numbers((-limits.torque, limits.torque))
    xx, xy, xz, yy, yz, zz = joint.body.inertia
    yield f"{indent}<body name={quoteattr(f'{joint.name}_link')} {_pose(joint.joint.origin)}>"
    yield f"{indent}  <joint {' '.join(f'{key}={quoteattr(value)}' for key, value in attributes.items())}/>"
    yield (
        f'{indent}  <inertial pos="{numbers(joint.body.com)}" mass="{number(joint.body.mass)}" '
        f'fullinertia="{numbers((xx, yy, zz, xy, xz, yz))}"/>'
    )

"""An arm to be written for other programs: what a format can express of it, and a list of what it cannot; URDF."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any
from xml.sax.saxutils import quoteattr

from symbolic.described import declared
from symbolic.elements import (
    Compliance,
    CreepFriction,
    Damper,
    Delay,
    DryFriction,
    Element,
    Gap,
    JointSpring,
    TiltedGravity,
)
from symbolic.model_file.arm import Arm, Frame, Joint, Values
from symbolic.model_file.exchange.tree import FREE, joints_of
from symbolic.model_file.exchange.ways import WAYS, Language, Standing, standing
from symbolic.model_file.frames import StatedBody, scaled

if TYPE_CHECKING:
    from symbolic.effects.declaration import Effect

DOWN = (0.0, 0.0, -9.81)
"""m/s²; gravity where a file states none, as programs assume it: URDF's z axis points up by convention (REP 103)."""
ROUNDING = 1e-12
"""Relative to a body's size or inertia: smaller values are rounding errors of the search for possible bodies."""


@dataclass(frozen=True)
class ExportedEffect:
    """An effect of the model and how it stands in the file.

    joint   from 1; None: of the whole arm     share   of the joint's torque that the file lacks, where it is known
    """

    name: str
    joint: int | None
    standing: Standing
    elements: tuple[Element, ...]
    share: float | None = None


@dataclass(frozen=True)
class ExportedJoint:
    """A joint to be written.

    mobility   its acceleration by a unit of torque on its link, with all joints at 0, 1/(kg m²) or 1/kg
    elements   what the file holds of its effects on the motor's side, in numbers
    carried    the same, of what the transmission carries to the link
    unknown    elements of effects whose values are unknown
    """

    name: str
    joint: Joint
    body: StatedBody
    rotor: float
    mobility: float
    elements: tuple[Element, ...] = ()
    carried: tuple[Element, ...] = ()
    unknown: frozenset[type[Element]] = frozenset()

    def of(self, *kinds: type[Element]) -> list[Any]:
        """Its elements of these kinds, on either side."""
        return [element for element in (*self.elements, *self.carried) if isinstance(element, kinds)]

    @property
    def damping(self) -> float:
        """Viscous friction, the mean of both directions, N m s/rad or N s/m."""
        return float(sum(damper.coefficient for damper in self.of(Damper)))

    @property
    def friction(self) -> float:
        """Dry friction, the mean of both directions, N m or N."""
        return float(sum(dry.torque for dry in self.of(DryFriction)))

    @property
    def spring(self) -> JointSpring | None:
        """The sum of its springs, if it has any."""
        springs = self.of(JointSpring)
        stiffness = float(sum(spring.stiffness for spring in springs))
        return JointSpring(stiffness, sum(s.stiffness * s.rest for s in springs) / stiffness) if stiffness else None


@dataclass(frozen=True)
class ExportedArm:
    """An arm to be written. keys: what the format cannot express beside effects, an item each."""

    arm: Arm
    joints: tuple[ExportedJoint, ...]
    effects: tuple[ExportedEffect, ...]
    keys: tuple[str, ...]

    @property
    def unsaid(self) -> list[str]:
        """What the format cannot express or the model does not know, an item each."""
        return [*_unsaid_effects(self.effects, len(self.joints)), *self.keys]

    def of(self, kind: type[Element]) -> list[tuple[int | None, Any]]:
        """Its elements of a kind, each with its joint."""
        return [(e.joint, element) for e in self.effects for element in e.elements if isinstance(element, kind)]


def exported(
    arm: Arm,
    library: Mapping[str, Effect],
    language: Language,
    bodies: Sequence[StatedBody],
    rotors: Sequence[float],
    mobilities: Sequence[float],
) -> ExportedArm:
    """The arm with complete bodies and what the format can express of its effects.

    bodies   possible bodies, in their joints' frames     rotors   inertias at the output     mobilities   of the links
    """
    effects: list[ExportedEffect] = []
    joints = []
    alike = {name: values for name, values in arm.effects.items() if _at_joints(name, library)}
    for k, (joint, body, rotor, mobility) in enumerate(zip(arm.joints, bodies, rotors, mobilities, strict=True), 1):
        made = Placed(library, language, k, rotor)
        for name, values in {**joint.effects, **alike}.items():
            made.add(name, values)
        effects += made.effects
        name = joint.name or f"joint{k}"
        sides = (tuple(made.elements), tuple(made.carried), frozenset(made.unknown))
        joints.append(ExportedJoint(name, joint, body, rotor, mobility, *sides))
    whole = Placed(library, language, None, rotor=0.0)
    contact = {} if arm.contact is None else arm.contact.effects
    for name, values in {**arm.effects, **contact}.items():
        if name not in alike:
            whole.add(name, values)
    effects += whole.effects
    tilts = [element for element in whole.elements if isinstance(element, TiltedGravity)]
    x, y, z = (sum(parts) for parts in zip(arm.gravity, *((t.x, t.y, t.z) for t in tilts), strict=True))
    keys = [*_unsaid_keys(arm, language, rotors)]
    if language == "urdf" and (x, y, z) != DOWN:
        keys.append(f"gravity {[x, y, z]}: loaders take {list(DOWN)}")
    return ExportedArm(replace(arm, gravity=(x, y, z)), tuple(joints), tuple(effects), tuple(keys))


def _at_joints(name: str, library: Mapping[str, Effect]) -> bool:
    return name in library and bool(library[name].alike_at_joints)


def alone(element: Element, library: Mapping[str, Effect]) -> tuple[str, Values] | None:
    """The effect whose law is this element and no other, with the element's numbers; None: there is none."""
    for name, effect in library.items():
        if [type(own) for own in effect.elements] == [type(element)]:
            of = {p.symbol: p.name for p in effect.parameters}
            values = {of.get(getattr(effect.elements[0], f.name)): getattr(element, f.name) for f in fields(element)}
            if None not in values:
                return name, {key: value for key, value in values.items() if key}
    return None


def elastic(arm: Arm, library: Mapping[str, Effect]) -> list[bool]:
    """For each joint, whether its link is behind a spring."""
    return [
        any(
            isinstance(element, Compliance | Gap)
            for name in joint.effects
            for element in declared(name, library).elements
        )
        for joint in arm.joints
    ]


@dataclass
class Placed:
    """Effects of a joint, or of the arm where joint is None, sorted into what the file holds of them."""

    library: Mapping[str, Effect]
    language: Language
    joint: int | None
    rotor: float
    effects: list[ExportedEffect] = field(default_factory=list)
    elements: list[Element] = field(default_factory=list)
    carried: list[Element] = field(default_factory=list)
    unknown: set[type[Element]] = field(default_factory=set)

    def add(self, name: str, values: Values) -> None:
        """Add an effect of the model file."""
        effect = declared(name, self.library)
        kinds = [type(element) for element in effect.elements]
        found: tuple[Element, ...] = ()
        there = standing(kinds, self.language)
        if any(p.name not in values and p.default is None for p in effect.parameters):
            self.unknown |= set(kinds)
            there = Standing("not", "", "its values are not known", 0.0)
        elif why := next(filter(None, map(self._impossible, effect.elements_at(values))), ""):
            there = Standing("not", "", why, 0.0)
        else:
            # Gravity is a vector of the written tree, whatever the format says of it.
            ways = {*WAYS[self.language], TiltedGravity}
            found = tuple(element for element in effect.elements_at(values) if type(element) in ways)
        self.effects.append(ExportedEffect(name, self.joint, there, found))
        (self.carried if effect.carried and self.joint else self.elements).extend(found)

    def _impossible(self, element: Element) -> str:
        """Why these numbers cannot be played; "" if they can."""
        if isinstance(element, Delay) and element.time < 0:
            return "no torque acts before its command"
        if isinstance(element, Compliance | Gap) and not self.rotor > 0:
            return "a motor before a spring needs a rotor_inertia above 0"
        if isinstance(element, CreepFriction) and any(
            isinstance(other, CreepFriction) and other.speed != element.speed for other in self.elements
        ):
            return "other friction of the joint falls with another speed"
        return ""


def _unsaid_effects(effects: Sequence[ExportedEffect], n: int) -> Iterator[str]:
    """What a file does not say of the effects, an item for all joints alike."""
    lacking: dict[tuple[str, str], list[ExportedEffect]] = {}
    for effect in effects:
        tilted = any(isinstance(element, TiltedGravity) for element in effect.elements)
        if effect.standing.played != "exact" and not tilted:
            lacking.setdefault((effect.name, effect.standing.but), []).append(effect)
    for (name, but), alike in lacking.items():
        there = {effect.joint for effect in alike}
        place = "of the arm" if None in there else f"at {joints_of([k in there for k in range(1, n + 1)])}"
        share = max((effect.share for effect in alike if effect.share is not None), default=None)
        part = "" if share is None else f" ({100 * share:.2g} % of the torque)"
        yield f"{name} {place}{part}{': ' * bool(but)}{but}"


def _unsaid_keys(arm: Arm, language: Language, rotors: Sequence[float]) -> Iterator[str]:
    """What a file does not say of the model file's other keys."""
    stated: dict[str, list[bool]] = {
        "torque_constant": [language != "bam" and joint.torque_constant is not None for joint in arm.joints],
        "encoder": [joint.encoder_counts is not None for joint in arm.joints],
        "controller": [joint.gains is not None for joint in arm.joints],
        "drive": [joint.drive is not None for joint in arm.joints],
        "limits.speed": [language != "urdf" and joint.limits.speed is not None for joint in arm.joints],
        "rotor_inertia": [language == "urdf" and bool(rotor) for rotor in rotors],
    }
    yield from (f"{key} of {joints_of(which)}" for key, which in stated.items() if any(which))


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
    lines = ['<?xml version="1.0"?>', *about(made), f"<robot name={quoteattr(made.arm.name)}>"]
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


def about(made: ExportedArm) -> list[str]:
    """Comments at the top of a file."""
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


def unit_axis(joint: ExportedJoint) -> tuple[float, float, float]:
    """The joint's axis, of length 1."""
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
    yield f'    <axis xyz="{numbers(unit_axis(joint))}"/>'
    low, high = limits.position or (-FREE, FREE)
    place = "" if kind == "continuous" else f'lower="{number(low)}" upper="{number(high)}" '
    yield f'    <limit {place}effort="{number(limits.torque or FREE)}" velocity="{number(limits.speed or FREE)}"/>'
    yield f'    <dynamics damping="{number(joint.damping)}" friction="{number(joint.friction)}"/>'
    yield "  </joint>"

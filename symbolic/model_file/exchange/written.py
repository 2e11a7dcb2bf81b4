"""URDF and MJCF written: an arm as a chain of links from `base` to `tip`, without shapes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from xml.sax.saxutils import quoteattr

from symbolic.model_file.arm import Frame
from symbolic.model_file.exchange.bodies import StatedBody
from symbolic.model_file.exchange.exporting import ExportedArm, ExportedJoint
from symbolic.model_file.exchange.tree import FREE
from symbolic.model_file.frames import scaled

DIGITS_OF_DOUBLE = 15
"""Of a number: as many as a double has for certain, so that the torques are those of the model."""
BASE, TIP = "base", "tip"


def urdf_text(made: ExportedArm) -> str:
    """The text of a URDF. Limits of effort and speed that are not known are FREE."""
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
            lines += _transmission(joint)
    return "\n".join([*lines, "</robot>"]) + "\n"


def _about(made: ExportedArm) -> list[str]:
    lines = [f"<!-- {made.arm.name}: written by tendon export; its bodies give the torques of the model. -->"]
    return [*lines, *(f"<!-- Not said here: {item}. -->" for item in made.unsaid)]


def number(value: float) -> str:
    """A number as it is written, of so many digits that a double comes back; no negative zero."""
    return f"{value + 0.0:.{DIGITS_OF_DOUBLE}g}"


def numbers(values: Sequence[float]) -> str:
    """Numbers with a blank between."""
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


def dynamics(joint: ExportedJoint) -> str:
    """<dynamics> of a joint."""
    damping, friction = (number(joint.dynamics.get(word, 0.0)) for word in ("damping", "friction"))
    return f'<dynamics damping="{damping}" friction="{friction}"/>'


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
    yield f"    {dynamics(joint)}"
    yield "  </joint>"


def _transmission(joint: ExportedJoint) -> list[str]:
    name = quoteattr(f"{joint.name} transmission")
    return [
        f"  <transmission name={name}>",
        "    <type>transmission_interface/SimpleTransmission</type>",
        f"    <joint name={quoteattr(joint.name)}/>",
        f"    <actuator name={quoteattr(f'{joint.name} motor')}>",
        f"      <mechanicalReduction>{number(joint.joint.gear_ratio)}</mechanicalReduction>",
        "    </actuator>",
        "  </transmission>",
    ]


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
        name = quoteattr(joint.name)
        lines.append(f'    <motor name={name} joint={name} gear="{number(joint.joint.gear_ratio)}"/>')
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

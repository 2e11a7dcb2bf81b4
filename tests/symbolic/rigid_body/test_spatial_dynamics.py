"""The recursion in space: against other equations, against laws of physics, and how short it is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
import spatial_arms
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from random_arms import arm as planar_arm
from spatial_arms import call, state

from codegen.tape.tape import Tape
from codegen.verify.proof import prove
from symbolic.functions import Exact, Turn
from symbolic.model import ArmModel, derive
from symbolic.model_file.arm import Arm, Frame, Joint, Link
from symbolic.model_file.checks import ModelError
from symbolic.rigid_body.spatial.base_parameters import columns, merging
from symbolic.rigid_body.spatial.geometry import geometry
from symbolic.rigid_body.spatial.recursion import motion

COUNTS = {
    "ur10e": {"inverse_dynamics": 428, "inertia": 241, "forward_dynamics": 688, "regressor": 570},
    "puma560": {"inverse_dynamics": 449, "inertia": 254, "forward_dynamics": 733},
    "rx90": {"inverse_dynamics": 429, "inertia": 222, "forward_dynamics": 682},
    "panda": {"inverse_dynamics": 555, "inertia": 361, "forward_dynamics": 1049, "regressor": 1130},
    "iiwa": {"inverse_dynamics": 522, "inertia": 318, "forward_dynamics": 951},
}
"""Operations; base parameters and rotors free at run time. The limits asked for: D and the forward dynamics 287 and 697
(UR10e), 387 and 1066 (Panda)."""


def of(*names: str) -> list[object]:
    """Known arms as parameters: the tests of one arm run in one process, which derives it once."""
    return [pytest.param(name, marks=pytest.mark.xdist_group(f"arm_{name}")) for name in names]


def model(name: str) -> ArmModel:
    return spatial_arms.derived(spatial_arms.known(name))


@pytest.mark.parametrize("name", of(*COUNTS))
def test_functions_are_short(name: str) -> None:
    """With a pair of sine and cosine a joint whose angle matters."""
    joints = len(model(name).arm.joints)
    for function, operations in COUNTS[name].items():
        count = spatial_arms.tape(model(name).function(function)).count()
        assert count["arithmetic"] <= operations
        assert function == "regressor" or count["sincos"] <= joints - 1
    assert len(model(name).lumps) == (40 if joints == 6 else 48)


DRAWN = ["r", "p", "rp", "pr", "rrr", "prp", "rrprrpr"]


@pytest.mark.parametrize("name", of(*COUNTS))
def test_torques_of_known_arms_are_those_of_newton_and_euler_body_by_body(name: str) -> None:
    check_torques(spatial_arms.known(name))


@pytest.mark.parametrize(
    "types", [*DRAWN, *(pytest.param(types, marks=pytest.mark.slow) for types in ("rrrrrr", "pprrrr"))]
)
def test_torques_of_drawn_arms_are_those_of_newton_and_euler_body_by_body(types: str) -> None:
    check_torques(spatial_arms.drawn(types, 5))


def test_torques_of_an_arm_without_quarter_turns_are_those_of_newton_and_euler() -> None:
    check_torques(spatial_arms.drawn("rrrrrrr", 2, general=1.0))


def check_torques(arm: Arm) -> None:
    derived = spatial_arms.derived(arm)
    for seed in range(3):
        q, qd, qdd = state(len(arm.joints), seed)
        expected = spatial_arms.torques(arm, q, qd, qdd)
        scale = np.abs(expected).max() + 1e-3
        assert_allclose(call(derived, "inverse_dynamics", q, qd, qdd), expected, atol=1e-10 * scale)
        lumps = np.array([lump.value for lump in derived.lumps])
        assert_allclose(call(derived, "regressor", q, qd, qdd) @ lumps, expected, atol=1e-10 * scale)


def in_space(arm: Arm) -> Arm:
    """A planar arm as one in space, without its tip; inertia about x and y must not matter."""
    inertias = [(0.01, 0.0, 0.0, 0.02, 0.0, joint.link.inertia[5]) for joint in arm.joints]
    joints = tuple(
        replace(joint, link=replace(joint.link, inertia=inertia), effects={})
        for joint, inertia in zip(arm.joints, inertias, strict=True)
    )
    return replace(arm, name=f"{arm.name}_in_space", joints=joints, tip=Frame(), space=True)


@pytest.mark.parametrize("types", ["r", "rr", "rrrr", "rprr", "prr"])
def test_a_planar_arm_in_space_has_the_same_torques(types: str) -> None:
    plane = planar_arm(types, (1.0, -9.0))
    space, flat = derive(in_space(plane)), derive(plane)
    assert len(space.lumps) == len(flat.lumps)
    for seed in range(3):
        q, qd, qdd = state(len(types), seed)
        for name, arguments in (("inverse_dynamics", (q, qd, qdd)), ("link_load", (q, qd, qdd)), ("gravity", (q,))):
            assert_allclose(call(space, name, *arguments), call(flat, name, *arguments), atol=1e-9)


@pytest.mark.xdist_group("arm_rx90")
def test_rotors_turn_with_their_joints_alone() -> None:
    arm = spatial_arms.known("rx90")
    q, qd, qdd = state(6, 3)
    heavier = replace(
        arm, joints=tuple(replace(j, rotor_inertia=j.rotor_inertia + i) for i, j in enumerate(arm.joints, 1))
    )
    more, less = derive(heavier), model("rx90")
    added = call(more, "inverse_dynamics", q, qd, qdd) - call(less, "inverse_dynamics", q, qd, qdd)
    assert_allclose(added, np.arange(1, 7) * qdd, atol=1e-10)
    assert_allclose(call(more, "link_load", q, qd, qdd), call(less, "link_load", q, qd, qdd))


@pytest.mark.xdist_group("arm_rx90")
def test_what_is_unknown_stays_unknown() -> None:
    """A link's numbers that are left out leave open what they merge into, and nothing else."""
    arm = spatial_arms.known("rx90")
    joints = list(arm.joints)
    joints[5] = replace(joints[5], link=Link(1.0, (0.0, 0.0, 0.1)), rotor_inertia=None)
    joints[2] = replace(joints[2], link=Link())
    derived = derive(replace(arm, joints=tuple(joints)))
    known = {lump.name: lump.value for lump in derived.lumps}
    assert known["MX6"] == 0.0
    assert known["MX4"] is not None
    assert {known[name] for name in ("XX6", "I6", "MX3", "XX3", "ZZ1")} == {None}
    assert len(derived.lumps) == len(model("rx90").lumps)


def test_values_of_an_identification_override() -> None:
    arm = replace(spatial_arms.known("rx90"), inertial={"XX4": 0.5})
    assert next(lump.value for lump in derive(arm).lumps if lump.name == "XX4") == 0.5
    with pytest.raises(ModelError, match='unknown base parameter "XX44"; did you mean "XX4"'):
        derive(replace(arm, inertial={"XX44": 0.5}))


@pytest.mark.parametrize("name", of("ur10e", "iiwa"))
def test_parts_give_the_base_parameters(name: str) -> None:
    """Inertia tensor, first moments and mass of every body in its own joint's frame, times `parts`."""
    arm = model(name)
    bodies = [spatial_arms.body_parameters(joint.link) | {"I": joint.rotor_inertia} for joint in arm.arm.joints]
    for lump in arm.lumps:
        assert lump.value == pytest.approx(sum(bodies[j - 1][own] * float(f) for j, own, f in lump.parts))


def rank(arm: Arm) -> int:
    """Of the regressor at random states, relative to the largest singular value of its columns scaled alike; the
    recursion from which it is generated, in floating point."""
    frames, n = geometry(arm), len(arm.joints)
    rests = [Turn(float(r.cos), float(r.sin)) if isinstance(r, Turn) else r for r in frames.rests]
    chain, kept, rows = frames.over(float, rests), merging(frames).kept, []
    for seed in range(12 * n):
        q, qd, qdd = state(n, seed)
        turned = [
            Turn(math.cos(x), math.sin(x)) if j.type == "revolute" else x for x, j in zip(q, arm.joints, strict=True)
        ]
        found = columns(chain, kept, motion(chain, range(n), turned, qd=qd, qdd=qdd, notes=Exact()), qdd, Exact())
        rows.append(np.array([found[c] for c in kept], dtype=float).T)
    Y = np.concatenate(rows)
    values = np.linalg.svd(Y / np.linalg.norm(Y, axis=0), compute_uv=False)
    return int(np.sum(values > 1e-9 * values[0]))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("types", ["rr", "pr", "rrp", "rrr", "rrrr"])
def test_base_parameters_are_independent(types: str, seed: int) -> None:
    arm = spatial_arms.drawn(types, seed, gravity=(1.0, 2.0, -9.0))
    assert rank(arm) == len(merging(geometry(arm)).kept)


def nice(types: str, choices: Sequence[float]) -> Arm:
    """A chain of joints whose angles, axes and offsets are some of a drawing's: many are parallel, perpendicular or
    meet, few along the axes of another's frame."""
    numbers = iter(choices)
    axes = ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 3.0, 4.0), (0.0, -1.0, 0.0))
    angles = (0.0, math.pi / 2, 0.3, math.pi / 6, -0.3, -math.pi / 2, math.pi / 3)

    def origin() -> Frame:
        rpy = [angles[next(numbers)] if turned == next(numbers) % 3 else 0.0 for turned in range(3)]
        return Frame(tuple(0.1 * (next(numbers) % 3) for _ in range(3)), tuple(rpy))

    link = Link(2.0, (0.1, -0.05, 0.02), (0.02, 0.001, -0.002, 0.03, 0.003, 0.025))
    joints = tuple(
        Joint(
            "revolute" if kind == "r" else "prismatic",
            0.1,
            50.0,
            origin=origin(),
            axis=axes[next(numbers) % 4],
            link=link,
        )
        for kind in types
    )
    angle, size = angles[next(numbers)], (9.81, 0.0, 9.81)[next(numbers) % 3]
    return Arm("nice", (0.0, size * math.sin(angle), -size * math.cos(angle)), joints)


def skew_slide(gravity: tuple[float, float, float] = (0.5, 0.0, -9.81)) -> Arm:
    """The first and the third joint turn about perpendicular axes; a slide along neither of them lies between."""
    origins = [
        Frame((0, 0, 0.3), (0.1, 0, 0)),
        Frame((0.1, 0, 0), (math.pi / 2, 0, 0)),
        Frame((0, 0.2, 0), (0, 0.3, 0)),
    ]
    axes, kinds = [(0.0, 0.0, 1.0), (0.0, 3.0, 4.0), (1.0, 0.0, 0.0)], ("revolute", "prismatic", "revolute")
    link = Link(2.0, (0.1, -0.05, 0.02), (0.02, 0.001, -0.002, 0.03, 0.003, 0.025))
    joints = zip(kinds, origins, axes, strict=True)
    return Arm("skew", gravity, tuple(Joint(k, 0.1, 50.0, origin=o, axis=a, link=link) for k, o, a in joints))


def test_axes_across_a_slide_are_perpendicular_exactly() -> None:
    derived = derive(skew_slide())
    assert rank(skew_slide()) == len(derived.lumps) == 14
    assert [p for p in prove(derived, {f.name: Tape.of(f) for f in derived.functions}, points=2) if not p.equal] == []


@given(
    types=st.text("rp", min_size=1, max_size=2) | st.sampled_from(["rpr", "ppr", "prr", "rppr", "rprr", "prpr", "rrr"]),
    choices=st.lists(st.integers(0, 6), min_size=60, max_size=60),
)
@settings(max_examples=25, deadline=None)
def test_what_holds_in_the_file_holds_in_the_base_parameters(types: str, choices: list[int]) -> None:
    """None is left that depends on others within the rounding of a file."""
    arm = nice(types, choices)
    assert rank(arm) == len(merging(geometry(arm)).kept)


@pytest.mark.xdist_group("arm_panda")
def test_symbols_of_the_definitions_are_no_inputs() -> None:
    for function in model("panda").functions:
        inputs = {s for a in function.arguments for s in a.symbols}
        assert not inputs & {symbol for symbol, _ in function.definitions}
        assert all(isinstance(symbol, sp.Symbol) for symbol, _ in function.definitions)

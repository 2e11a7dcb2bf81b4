"""What is emitted of an arm in space is its Lagrangian, exactly; and what is not is found out.

Nothing here has a tolerance: all == compare residues modulo a prime.
"""

from __future__ import annotations

import random
import time
from dataclasses import replace
from pathlib import Path

import pytest
import spatial_arms

from codegen.tape.numbering import Node
from codegen.tape.tape import Tape
from codegen.verify import lagrangian, proof
from codegen.verify.lagrangian import ELEMENTS, PRIME, ExactChain, ExactPosture, pseudo_inertia
from codegen.verify.proof import prove
from symbolic.functions import random_turn
from symbolic.model import ArmModel
from symbolic.model_file import reader
from symbolic.model_file.arm import Arm, Frame
from symbolic.rigid_body.spatial.geometry import geometry

ARMS = Path(__file__).resolve().parents[3] / "symbolic" / "arms"
KNOWN = [pytest.param(name, marks=pytest.mark.xdist_group(f"arm_{name}")) for name in spatial_arms.TABLES]
DRAWN = [("r", 1), ("p", 2), ("rr", 3), ("pr", 4), ("rpr", 5), ("ppr", 6), ("rrrp", 7), ("rprrr", 8), ("rrrrrr", 9)]
DRAWN += [("rrprrpr", 10)]


def derived(arm: Arm) -> tuple[ArmModel, dict[str, Tape]]:
    model = spatial_arms.derived(arm)
    return model, {f.name: spatial_arms.tape(f) for f in model.functions}


def differing(arm: Arm, tapes: dict[str, Tape] | None = None, points: int = 2) -> list[str]:
    """The functions that are not the Lagrangian's."""
    model, own = derived(arm)
    return [p.function for p in prove(model, own | (tapes or {}), points) if not p.equal]


@pytest.mark.parametrize("name", KNOWN)
def test_known_arms_are_proved_at_ten_points(name: str) -> None:
    assert differing(spatial_arms.known(name), points=10) == []


def test_all_arms_in_space_that_ship_are_proved_at_ten_points() -> None:
    arms = [reader.load(path) for path in sorted(ARMS.glob("*.toml"))]
    spatial = [arm for arm in arms if arm.space]
    assert len(spatial) >= 2
    assert {arm.name: differing(arm, points=10) for arm in spatial} == {arm.name: [] for arm in spatial}


GENERAL = [(types, seed, 0.3) for types, seed in DRAWN]
GENERAL += [("prrp", 102, 1.0), ("pprr", 104, 0.3)]
LONG = [("rrrrrr", 100, 0.0), ("rrprrpr", 101, 0.3), ("rrrrrrr", 103, 0.0), ("rprrr", 105, 1.0)]


@pytest.mark.parametrize(
    ("types", "seed", "general"), [*GENERAL, *(pytest.param(*case, marks=pytest.mark.slow) for case in LONG)]
)
def test_random_arms_are_proved(types: str, seed: int, general: float) -> None:
    """Turning and sliding joints, gravity from anywhere. general: the share of angles and axes off quarter turns."""
    assert differing(spatial_arms.drawn(types, seed, general=general)) == []


def test_unknown_rotors_are_proved() -> None:
    """link_load and link_inertia then do without a base parameter, or its share."""
    arm = spatial_arms.drawn("rrp", 3)
    open_ones = tuple(replace(joint, rotor_inertia=None) for joint in arm.joints)
    assert differing(replace(arm, joints=open_ones)) == []


def spoilt(tape: Tape, rng: random.Random) -> Tape:
    """One addition turned into a subtraction, or one constant that is not 0 off by a millionth."""
    nodes = list(tape.nodes)
    told = [i for i, node in enumerate(nodes) if node.op in ("add", "sub") or (node.op == "const" and node.value)]
    chosen = rng.choice(told)
    node = nodes[chosen]
    if node.op == "const":
        nodes[chosen] = Node("const", (), node.value * (1 + proof.Fraction(1, 10**6)))
    else:
        nodes[chosen] = Node("sub" if node.op == "add" else "add", node.args)
    return replace(tape, nodes=tuple(nodes))


@pytest.mark.xdist_group("arm_puma560")
@pytest.mark.parametrize("name", ["inverse_dynamics", "coriolis", "forward_dynamics", "regressor", "tip_load", "tip"])
def test_one_wrong_sign_or_digit_is_found(name: str) -> None:
    arm, rng = spatial_arms.known("puma560"), random.Random(name)
    tape = derived(arm)[1][name]
    for _ in range(8):
        assert differing(arm, {name: spoilt(tape, rng)}, points=1) == [name]


def test_frames_that_are_not_the_files_are_found() -> None:
    arm = spatial_arms.known("rx90")
    model, tapes = derived(arm)
    first, *others = arm.joints
    moved = replace(first, origin=Frame((0.0, 0.0, 1e-6), first.origin.rpy))
    chain = lagrangian.exact_file_chain(geometry(arm))
    assert lagrangian.deviation(arm, chain) < 1e-12
    assert lagrangian.deviation(replace(arm, joints=(moved, *others)), chain) == pytest.approx(1e-6, rel=1e-3)
    other = replace(model, arm=replace(arm, gravity=(0.0, 0.0, -9.80)))
    assert [p.function for p in prove(other, tapes, 1) if not p.equal] != []


def posture(arm: Arm, seed: int) -> tuple[ExactPosture, list[int], list[int]]:
    rng = random.Random(seed)
    chain = ExactChain.of(lagrangian.exact_file_chain(geometry(arm)))
    q = [random_turn(rng, PRIME) if turns else rng.randrange(PRIME) for turns in chain.revolute]
    bodies = [pseudo_inertia([rng.randrange(PRIME) for _ in ELEMENTS]) for _ in q]
    qd, qdd = ([rng.randrange(PRIME) for _ in q] for _ in range(2))
    return chain.posture(q, bodies), qd, qdd


@pytest.mark.parametrize(("types", "seed"), DRAWN)
def test_the_lagrangian_agrees_with_itself(types: str, seed: int) -> None:
    """Accelerations by jets in time, and D, C, g by derivatives of T: two ways to one torque."""
    at, qd, qdd = posture(spatial_arms.drawn(types, seed), seed)
    D, C, g = at.inertia, at.coriolis(qd), at.gravity()
    torque = [
        (sum(d * a for d, a in zip(D[i], qdd, strict=True)) + sum(c * v for c, v in zip(C[i], qd, strict=True)) + g[i])
        % PRIME
        for i in range(at.n)
    ]
    assert at.torques(qd, qdd) == torque
    assert [list(row) for row in zip(*D, strict=True)] == D


def test_a_point_takes_milliseconds() -> None:
    """One evaluation of Lagrange's equations of seven joints: limit 10 ms, some 1 ms on a quiet machine."""
    arm = spatial_arms.known("panda")
    spent = []
    for seed in range(5):
        at, qd, qdd = posture(arm, seed)
        start = time.process_time()
        at.torques(qd, qdd)
        spent.append(time.process_time() - start)
    assert min(spent) < 10e-3

"""derive(): what a model consists of, what its numbers are, units, energy; and the arms that come with it."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import exact
import pytest

import symbolic
from symbolic.model import derive
from symbolic.model_file.arm import Arm, Joint, planar, planar_link
from symbolic.model_file.checks import ModelError
from symbolic.model_file.reader import load

ARMS = Path(symbolic.__file__).parent / "arms"
EVERY = ["inverse_dynamics", "link_load", "inertia", "link_inertia", "coriolis", "gravity"]
EVERY += ["forward_dynamics", "regressor", "tip", "tip_jacobian", "tip_rate", "tip_load", "moment_jacobian"]
CONTACT = [f"contact_{x}" for x in ("coordinates", "jacobian", "bias", "inverse", "acceleration")]


def lumps(arm: Arm) -> dict[str, tuple[float, str]]:
    return {lump.name: (lump.value, lump.unit) for lump in derive(arm).lumps}


# --- what is in it ---


@pytest.mark.parametrize("types", ["R", "P", "RRRR", "RPR", "RRRRRRR"])
def test_model_is_complete_and_closed(types: str) -> None:
    model = derive(exact.chain_of(types, (0.0, -9.81), 0.01))
    assert [f.name for f in model.functions] == EVERY + (CONTACT if types == "RRRR" else [])
    names = [s.name for s in model.struct.symbols]
    assert names[: len(model.lumps)] == [lump.name for lump in model.lumps]
    assert len(names) == len(set(names)) == len(model.struct.defaults) == len(model.struct.units)
    for f in model.functions:
        known = {s for a in f.inputs for s in a.symbols} | set(model.struct.symbols)
        for symbol, expr in f.definitions:
            assert expr.free_symbols <= known
            assert symbol not in known
            known.add(symbol)
        for output in f.outputs:
            assert math.prod(output.shape) == len(output.expressions)
            assert all(e.free_symbols <= known for e in output.expressions)


def test_derivation_is_deterministic() -> None:
    arm = exact.chain_of("RRPR", (1.0, -9.0), 0.01)
    assert derive(arm) == derive(arm)


def test_base_parameters_of_simple_arms() -> None:
    assert lumps(exact.chain_of("R")) == {"J1": (pytest.approx(0.3 + 0.012 + 2.5 * 0.11**2), "kg m^2")}
    assert lumps(exact.chain_of("R", (0.0, -9.8)))["h1"] == (pytest.approx(2.5 * 0.11), "kg m")
    assert lumps(exact.chain_of("P")) == {"M1": (pytest.approx(2.8), "kg")}
    assert lumps(exact.chain_of("P", (9.8, 0.0))) == {"I1": (0.3, "kg"), "M1": (2.5, "kg")}
    assert lumps(exact.chain_of("P", (0.0, 9.8))) == {"M1": (pytest.approx(2.8), "kg")}
    assert list(lumps(exact.chain_of("PP"))) == ["I2", "M1", "M2"]
    two = lumps(exact.chain_of("RR"))
    assert two["h2"] == (pytest.approx(2.5 * 0.11 * 0.23), "kg m^2")
    assert two["J1"][0] == pytest.approx(0.3 + 0.012 + 2.5 * 0.11**2 + 2.5 * 0.23**2)


def test_four_joint_arm_has_ten_base_parameters_eleven_with_gravity() -> None:
    assert list(lumps(exact.chain_of("RRRR"))) == ["J1", "J2", "J3", "J4", "I2", "I3", "I4", "mu2", "mu3", "h4"]
    assert len(lumps(exact.chain_of("RRRR", (0.0, 9.81)))) == 11


def test_centre_of_mass_off_the_line_adds_a_moment_a_link() -> None:
    names = list(lumps(exact.chain_of("RRR", across=0.01)))
    assert [n for n in names if n.startswith("hy")] == ["hy2", "hy3"]


def test_identified_values_in_the_file_replace_those_of_the_links() -> None:
    arm = replace(exact.chain_of("RR"), inertial={"h2": 0.07})
    model = derive(arm)
    assert lumps(arm)["h2"][0] == 0.07
    assert model.struct.defaults[[s.name for s in model.struct.symbols].index("h2")] == 0.07


def test_unknown_base_parameter_in_the_file_is_one_clear_line() -> None:
    with pytest.raises(ModelError) as error:
        derive(replace(exact.chain_of("RR"), inertial={"hy2": 0.07}))
    assert str(error.value) == (
        'chain: inertial: unknown base parameter "hy2"; did you mean "h2"? (this arm has J1, J2, I2, h2)'
    )


# --- the arms that come with it ---


def test_vishard4_reproduces_what_is_published_of_it() -> None:
    arm = load(ARMS / "vishard4.toml")
    D = exact.in_floats(derive(arm), "inertia")
    # D_44 follows from Table II; the file's decimals give it exactly, the tolerance is rounding.
    assert D([0.3, -0.4, 0.5, 0.6])[15] == pytest.approx(0.2365, rel=1e-14)
    assert [j.gear_ratio for j in arm.joints] == [100] * 4
    assert [j.limits.speed for j in arm.joints] == [2.0, 2.0, 2.5, 5.0]
    assert [j.effects["viscous"]["coefficient"] for j in arm.joints] == [2.53, 2.18, 1.93, 1.14]
    assert [j.effects["viscous_cubic"]["coefficient"] for j in arm.joints] == [-0.21, -0.19, -0.12, -0.015]
    assert arm.joints[3].effects["parallel_spring"]["radius"] == 0.06
    assert "parallel_spring" not in arm.joints[0].effects
    assert arm.contact is not None


def test_vishard4_links_are_rods_with_a_mass_at_the_far_end() -> None:
    """The comment in the file, computed; six decimals in the file."""
    arm = load(ARMS / "vishard4.toml")
    for joint, l, end in zip(arm.joints, arm.lengths, (0.23, 0.23, 0.68, 0.86), strict=True):
        rod = 4.28 * l
        centre = (rod * l / 2 + end * l) / (rod + end)
        about = rod * l**2 / 12 + rod * (centre - l / 2) ** 2 + end * (l - centre) ** 2
        assert joint.link.mass == pytest.approx(rod + end, abs=1e-6)
        assert joint.link.com == (pytest.approx(centre, abs=1e-6), 0.0, 0.0)
        assert joint.link.inertia[5] == pytest.approx(about, abs=1e-6)


def test_test_bench_and_emps() -> None:
    assert lumps(load(ARMS / "drive.toml")) == {"J1": (pytest.approx(0.2365), "kg m^2")}
    emps = load(ARMS / "emps.toml")
    assert lumps(emps) == {"M1": (95.0, "kg")}
    assert emps.joints[0].effects == {"coulomb": {}, "viscous": {}, "offset": {}}


# --- kinematics ---


@pytest.mark.parametrize("types", ["RRRR", "RPR", "PRP", "RRRRRRR"])
def test_tip_and_its_jacobian(types: str) -> None:
    case = exact.case(exact.chain_of(types, (1.0, -9.0), 0.01))
    state = case.point(1)
    q = state["q"]
    x, y, turn = 0, 0, exact.Turn(exact.Fraction(1), exact.Fraction(0))
    for joint, length, position in zip(case.arm.joints, case.arm.lengths, q, strict=True):
        turn = turn + position if joint.type == "revolute" else turn
        reach = exact.exact(length) + (0 if joint.type == "revolute" else position)
        x, y = x + reach * turn.cos, y + reach * turn.sin
    J = case.matrix("tip_jacobian", q=q)
    f = case.model.function("tip")
    short = replace(f, outputs=(replace(f.outputs[0], expressions=f.outputs[0].expressions[:2]),))
    assert exact.call(short, case.values(q=q)) == [x, y]
    for i, joint in enumerate(case.arm.joints):
        turned = [exact.moving(p, exact.Fraction(int(i == j))) for j, p in enumerate(q)]
        assert [row[i] for row in J[:2]] == [
            e.slope for e in map(exact.Dual.of, exact.call(short, case.values(q=turned)))
        ]
        assert J[2][i] == (joint.type == "revolute")


@pytest.mark.parametrize("types", ["RRRR", "RPR", "PRP"])
def test_tip_load_is_what_a_mass_there_adds(types: str) -> None:
    """A second arm carries 2 kg at its end: the difference of the torques, exactly. Same for gravity's moments."""
    arm = exact.chain_of(types, (1.0, -9.0))
    # 2.5 kg at 0.11 and 2 kg at the end, as one link with centre of mass c and inertia about it
    mass, added = exact.Fraction(5, 2), exact.Fraction(2)
    length = exact.exact(arm.lengths[-1])
    centre = (mass * exact.Fraction("0.11") + added * length) / (mass + added)
    about = exact.Fraction("0.012") + mass * (centre - exact.Fraction("0.11")) ** 2 + added * (length - centre) ** 2
    case = exact.case(arm)
    state = case.point(2)
    heavier = planar_link(4.5, (float(centre), 0.0), float(about))
    loaded = exact.case(replace(arm, joints=(*arm.joints[:-1], replace(arm.joints[-1], link=heavier))))
    difference = [
        float(a - b)
        for a, b in zip(loaded.call("inverse_dynamics", **state), case.call("inverse_dynamics", **state), strict=True)
    ]
    # centre and inertia are rounded to floats in the second arm: 1e-16, times some ten for cancellation
    assert [2 * float(x) for x in case.call("tip_load", **state)] == pytest.approx(difference, rel=1e-12)


@pytest.mark.parametrize("types", ["RRRR", "RPR", "PRP"])
def test_moments_give_gravity(types: str) -> None:
    case = exact.case(exact.chain_of(types, (1.0, -9.0), 0.01))
    q = case.point(3)["q"]
    x, y = case.matrix("moment_jacobian", q=q)
    assert case.call("gravity", q=q) == [-(a - 9 * b) for a, b in zip(x, y, strict=True)]


@pytest.mark.parametrize("types", ["R", "P", "RRRR", "RPR", "PRP"])
def test_links_are_what_an_arm_without_rotors_is(types: str) -> None:
    arm = exact.chain_of(types, (1.0, -9.0), 0.01)
    light = exact.case(replace(arm, joints=tuple(replace(joint, rotor_inertia=0.0) for joint in arm.joints)))
    case = exact.case(arm)
    state = case.point(4)
    assert case.call("link_load", **state) == light.call("inverse_dynamics", **state)
    assert case.call("link_inertia", q=state["q"]) == light.call("inertia", q=state["q"])


@pytest.mark.parametrize("types", ["R", "P", "RRRR", "RPR", "PRP"])
def test_tip_moves_as_its_jacobian_says(types: str) -> None:
    case = exact.case(exact.chain_of(types, (0.0, 0.0), 0.01))
    state = case.point(5)
    J = case.matrix("tip_jacobian", q=state["q"])
    expected = [sum(a * b for a, b in zip(row, state["qd"], strict=True)) for row in J]
    assert case.call("tip_rate", q=state["q"], qd=state["qd"]) == expected


# --- energy and units, in floating point ---


@pytest.mark.parametrize("types", ["RRRR", "RPR", "PRR"])
def test_energy_is_conserved_without_effects(types: str) -> None:
    """Runge-Kutta 4 over half a second; halving the step divides the drift by 16 or more (its order), which
    rounding would not do, and the drift itself is far below the energy that is exchanged."""
    model = derive(exact.chain_of(types, (2.0, -9.0), 0.01))
    forward, inertia = (exact.in_floats(model, name) for name in ("forward_dynamics", "inertia"))
    potential = exact.in_floats(model, "gravity")
    n = len(types)

    def rate(state: list[float]) -> list[float]:
        q, qd = state[:n], state[n : 2 * n]
        # the last entry is the work of gravity: V without its formula
        work = sum(a * b for a, b in zip(potential(q), qd, strict=True))
        return [*qd, *forward(q, qd, [0.0] * n), work]

    def energy(state: list[float]) -> float:
        D, qd = inertia(state[:n]), state[n : 2 * n]
        return 0.5 * sum(D[i * n + j] * qd[i] * qd[j] for i in range(n) for j in range(n)) + state[-1]

    def drift(steps: int) -> float:
        state = [0.3 + 0.1 * i for i in range(n)] + [1.0 - 0.7 * i for i in range(n)] + [0.0]
        start, dt = energy(state), 0.5 / steps
        for _ in range(steps):
            k1 = rate(state)
            k2 = rate([s + dt / 2 * k for s, k in zip(state, k1, strict=True)])
            k3 = rate([s + dt / 2 * k for s, k in zip(state, k2, strict=True)])
            k4 = rate([s + dt * k for s, k in zip(state, k3, strict=True)])
            state = [s + dt / 6 * (a + 2 * b + 2 * c + d) for s, a, b, c, d in zip(state, k1, k2, k3, k4, strict=True)]
        return abs(energy(state) - start)

    coarse, fine = drift(50), drift(100)
    assert fine < 1e-6
    assert fine < coarse / 14


KG, M, S = 4.0, 2.0, 0.5  # new units per old: all numbers change, by powers of two


def rescaled(arm: Arm) -> Arm:
    def joint(j: Joint) -> Joint:
        com = (j.link.com[0] * M, j.link.com[1] * M)
        changed = planar_link(j.link.mass * KG, com, j.link.inertia[5] * KG * M**2)
        return replace(j, rotor_inertia=j.rotor_inertia * KG * (M**2 if j.type == "revolute" else 1), link=changed)

    gx, gy, _ = arm.gravity
    made = replace(arm, gravity=(gx * M / S**2, gy * M / S**2, 0.0), joints=tuple(map(joint, arm.joints)))
    return planar(made, [length * M for length in arm.lengths])


def scale(unit: str) -> float:
    """Of a unit as the struct writes it: products of kg, m, s, rad, 1 with powers, one slash."""
    above, _, below = unit.partition("/")
    total = 1.0
    for part, sign in ((above, 1), (below, -1)):
        for name, power in re.findall(r"(kg|m|s|rad|1)(?:\^(\d))?(?= |$)", part):
            total *= {"kg": KG, "m": M, "s": S, "rad": 1.0, "1": 1.0}[name] ** (sign * int(power or 1))
    return total


@pytest.mark.parametrize("types", ["R", "P", "RR", "RRRR", "RPR", "PRP"])
@pytest.mark.parametrize("gravity", [(0.0, 0.0), (0.0, -9.0), (2.0, -9.0)])
def test_every_function_keeps_its_units(types: str, gravity: tuple[float, float]) -> None:
    """Every function, in other units of kg, m and s, gives the same in other units; so do lumps and constants.

    Tolerance: the two evaluations round alike but for the lumps' own rounding to double, 1e-16, times cancellation.
    """
    arm = exact.chain_of(types, gravity, 0.01)
    one, other = derive(arm), derive(rescaled(arm))
    for unit, a, b in zip(one.struct.units, one.struct.defaults, other.struct.defaults, strict=True):
        assert b == pytest.approx(a * scale(unit), rel=1e-14)
    coordinate = [1.0 if t == "R" else M for t in types]  # unit of each joint's position; force is energy by position
    energy = KG * M**2 / S**2
    of = {
        "q": coordinate,
        "qd": [c / S for c in coordinate],
        "qdd": [c / S**2 for c in coordinate],
        "tau": [energy / c for c in coordinate],
        "w": [M, M, 1.0, 1.0],
        "wdd": [M / S**2, M / S**2, 1 / S**2, 1 / S**2],
        "elbow": [1.0],
    }
    pairs = [(a, b) for a in coordinate for b in coordinate]
    place = [M, M, 1.0]
    by_lump = [scale(lump.unit) for lump in one.lumps]
    out = {
        "inverse_dynamics": of["tau"],
        "link_load": of["tau"],
        "gravity": of["tau"],
        "forward_dynamics": of["qdd"],
        "inertia": [energy * S**2 / (a * b) for a, b in pairs],
        "link_inertia": [energy * S**2 / (a * b) for a, b in pairs],
        "coriolis": [energy * S / (a * b) for a, b in pairs],
        "regressor": [t / lump for t in of["tau"] for lump in by_lump],
        "tip": place,
        "tip_jacobian": [p / c for p in place for c in coordinate],
        "tip_rate": [p / S for p in place],
        "tip_load": [t / KG for t in of["tau"]],
        "moment_jacobian": [KG * M / c for _ in range(2) for c in coordinate],
        "contact_coordinates": of["w"],
        "contact_jacobian": [M] * 8 + [1.0] * 8,
        "contact_bias": of["wdd"],
        "contact_inverse": of["q"],
        "contact_acceleration": of["qdd"],
    }
    numbers = {"q": [0.3, -0.7, 1.1, 0.4], "qd": [1.2, -0.5, 0.8, -1.4], "qdd": [2.0, 3.0, -4.0, 1.0]}
    numbers |= {"tau": [1.0, -2.0, 3.0, 0.5], "w": [0.4, 0.2, 0.5, -0.3], "wdd": [1.0, -2.0, 3.0, 0.5], "elbow": [1.0]}
    for f in one.functions:
        values = [numbers[a.name][: max(1, math.prod(a.shape))] for a in f.inputs]
        changed = [[x * s for x, s in zip(v, of[a.name], strict=False)] for v, a in zip(values, f.inputs, strict=True)]
        here, there = exact.in_floats(one, f.name)(*values), exact.in_floats(other, f.name)(*changed)
        expected = [x * s for x, s in zip(here, out[f.name], strict=True)]
        assert there == pytest.approx(expected, rel=1e-10, abs=1e-12), f.name

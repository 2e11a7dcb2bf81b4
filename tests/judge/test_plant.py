"""Physics of the plant that the diagnosis is judged by, and the sizes of what it hides."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from runtime.arrays import Array

from . import cases, motion
from .bodies import ARMS, BELIEVED, inertial_columns, inertial_values
from .hidden import ENTRIES
from .plant import PERIOD, names, simulate

FRICTIONLESS = {
    "DRY_POSITIVE": 0.0,
    "DRY_NEGATIVE": 0.0,
    "VISCOUS_POSITIVE": 0.0,
    "VISCOUS_NEGATIVE": 0.0,
    "CUBIC": 0.0,
}


def still(n: int, seconds: float, angle: float = 0.0) -> Array:
    motion = np.zeros((3, n, round(seconds / PERIOD)))
    motion[0] = angle
    return motion


def rows(n: int, **values: float) -> list[dict[str, float]]:
    """Bodies without a controller."""
    return [{**body.parameters(), **values} for body in ARMS[n]]


def energy(n: int, q: Array, qd: Array, gravity: tuple[float, float]) -> Array:
    """Kinetic and potential energy (N,) J of the arm's bodies, point by point."""
    angle, rate = np.cumsum(q, 0), np.cumsum(qd, 0)
    place, moved = np.zeros((2, q.shape[1])), np.zeros((2, q.shape[1]))
    total = np.zeros(q.shape[1])
    for k, body in enumerate(ARMS[n]):
        along = np.array([np.cos(angle[k]), np.sin(angle[k])])
        across = np.array([-along[1], along[0]])
        com = place + body.com[0] * along + body.com[1] * across
        speed = moved + rate[k] * (body.com[0] * across - body.com[1] * along)
        total += 0.5 * body.mass * (speed**2).sum(0) + 0.5 * body.inertia * rate[k] ** 2 + 0.5 * body.rotor * qd[k] ** 2
        total -= body.mass * (gravity[0] * com[0] + gravity[1] * com[1])
        place, moved = place + body.length * along, moved + body.length * rate[k] * across
    return total


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_a_falling_arm_keeps_its_energy(n: int) -> None:
    gravity = (0.0, -9.81)
    run = simulate(rows(n, **FRICTIONLESS), still(n, 3.0), {"GRAVITY_X": gravity[0], "GRAVITY_Y": gravity[1]})
    rate = np.gradient(run.q, PERIOD, axis=1)
    total = energy(n, run.q, rate, gravity)[5:-5]
    kinetic = total - energy(n, run.q, 0.0 * rate, gravity)[5:-5]
    assert kinetic.max() > 1.0
    # Second-order differences of the samples and second-order steps: some 1e-5 of what is exchanged.
    assert np.abs(total - total[0]).max() < 1e-3 * kinetic.max()


def test_a_falling_link_keeps_its_energy_behind_a_spring() -> None:
    stiffness = 500.0
    run = simulate(rows(1, **FRICTIONLESS, STIFFNESS=stiffness), still(1, 3.0), {"GRAVITY_Y": -9.81, "SUBSTEPS": 16.0})
    body = ARMS[1][0]
    motor, link = np.gradient(run.q[0], PERIOD), np.gradient(run.link[0], PERIOD)
    inertia = body.inertia + body.mass * body.com[0] ** 2
    total = 0.5 * body.rotor * motor**2 + 0.5 * inertia * link**2 + 0.5 * stiffness * (run.q[0] - run.link[0]) ** 2
    total += body.mass * 9.81 * body.com[0] * np.sin(run.link[0])
    kinetic = 0.5 * (inertia + body.rotor) * link**2
    assert np.ptp(run.q[0] - run.link[0]) > 1e-3
    assert np.abs(total - total[5])[5:-5].max() < 2e-3 * kinetic.max()


@pytest.mark.parametrize("n", [1, 4])
@pytest.mark.parametrize("share", [0.98, 1.02])
def test_dry_friction_holds_below_its_level_only(n: int, share: float) -> None:
    """In an arm, each joint pushed by nearly its level at once: nothing moves at all, or everything does."""
    wanted = still(n, 1.0)
    level = np.array([body.dry[0] for body in ARMS[n]])
    forward = np.broadcast_to(share * level[:, None], wanted.shape[1:])
    run = simulate(rows(n), wanted, forward=forward)
    if share < 1:
        assert np.all(run.q == 0.0)
        assert np.allclose(run.above, share, rtol=1e-9)
    else:
        assert np.all(np.abs(run.q[:, -1]) > 0.0)


def test_a_pushed_joint_settles_at_the_speed_of_its_viscous_friction() -> None:
    body = ARMS[1][0]
    wanted = still(1, 4.0)
    run = simulate(rows(1, CUBIC=0.0), wanted, forward=np.full(wanted.shape[1:], -3.0))
    assert run.rate[0, -1] == pytest.approx(-(3.0 - body.dry[1]) / body.viscous, rel=1e-6)


THINNED = {"THIN": 0.4, "THIN_SPEED": 1.5}
LOGARITHM = {"POWER": 0.5, "POWER_FORM": 1.0, "POWER_SPEED": 0.1}
UNEVEN = {"UNEVEN": 0.6, "UNEVEN_SPEED": 0.4}


@pytest.mark.parametrize(
    ("law", "torque"),
    [
        (THINNED, lambda v: -0.4 * (v - 1.5 * np.arcsinh(v / 1.5))),
        (LOGARITHM, lambda v: 0.5 * np.sign(v) * np.log1p(np.abs(v) / 0.1)),
        (UNEVEN, lambda v: 0.3 * (np.hypot(v, 0.4) - 0.4)),
    ],
)
@pytest.mark.parametrize("push", [-4.0, 3.0])
def test_a_pushed_joint_settles_where_its_frictions_balance_the_push(
    law: dict[str, float], torque: Callable[[float], float], push: float
) -> None:
    body = ARMS[1][0]
    wanted = still(1, 6.0)
    run = simulate(rows(1, CUBIC=0.0, **law), wanted, forward=np.full(wanted.shape[1:], push))
    v = run.rate[0, -1]
    dry = body.dry[0] if v > 0 else -body.dry[1]
    assert dry + body.viscous * v + torque(v) == pytest.approx(push, rel=1e-6)


def test_a_soft_kink_is_a_sharp_one_from_afar() -> None:
    """At its width from the kink a soft spring pulls ln(1 + e)/1 times as hard; ten widths away as a sharp one."""
    spring = {"PULL": 2.0, "PULL_FROM": 0.0, "PULL_FIRST": 0.3}
    for place, soft, pulled in ((-0.5, 0.05, 1.3), (-0.05, 0.05, 0.1 * np.log1p(np.e) + 0.3 / (1 + np.exp(-1)))):
        run = simulate(rows(1, **FRICTIONLESS, **spring, PULL_SOFT=soft), still(1, 0.01, place))
        inertia = 0.1 + 0.0565 + 2.0 * 0.2**2
        assert inertia * run.acceleration[0, 0] == pytest.approx(pulled, rel=1e-3)


def test_an_extended_payload_adds_its_own_inertia_about_the_joint() -> None:
    wanted = still(1, 0.01)
    arm = {"PAYLOAD": 0.5, "PAYLOAD_AHEAD": 0.08, "PAYLOAD_RADIUS": 0.06}
    run = simulate(rows(1, **FRICTIONLESS), wanted, arm, forward=np.ones(wanted.shape[1:]))
    inertia = 0.1 + 0.0565 + 2.0 * 0.2**2 + 0.5 * (0.38**2 + 0.06**2)
    assert run.acceleration[0, 0] * inertia == pytest.approx(1.0, rel=1e-6)


def test_an_extended_payload_is_a_part_of_the_last_link() -> None:
    gravity = {"GRAVITY_Y": -9.81}
    carried = {"PAYLOAD": 0.4, "PAYLOAD_AHEAD": 0.08, "PAYLOAD_RADIUS": 0.06, **gravity}
    loose = rows(2, **FRICTIONLESS)
    last = loose[-1]
    at = last["LENGTH"] + 0.08
    mass, along = last["MASS"] + 0.4, (last["MASS"] * last["COM_X"] + 0.4 * at) / (last["MASS"] + 0.4)
    about = last["INERTIA"] + last["MASS"] * (last["COM_X"] - along) ** 2 + 0.4 * ((at - along) ** 2 + 0.06**2)
    heavy = [loose[0], {**last, "MASS": mass, "COM_X": along, "INERTIA": about}]
    loaded, alike = simulate(loose, still(2, 1.0), carried), simulate(heavy, still(2, 1.0), gravity)
    assert np.abs(loaded.q).max() > 0.5
    assert np.allclose(loaded.q, alike.q, rtol=0, atol=1e-9)


def test_round_flanks_are_as_stiff_as_their_depth_says() -> None:
    """The link hangs still at the depth at which the flank carries the push: K x (x/x0)^(1/2)."""
    flank = {"STIFFNESS": 1e4, "GAP": 2e-3, "GAP_EXPONENT": 1.5, "GAP_DEPTH": 1e-4, "STIFFNESS_DAMPING": 20.0}
    body = {"SPRING": 1e3, **flank}
    wanted = still(1, 3.0)
    dry = {"DRY_POSITIVE": 0.0, "DRY_NEGATIVE": 0.0, "VISCOUS_POSITIVE": 20.0, "VISCOUS_NEGATIVE": 20.0, "CUBIC": 0.0}
    run = simulate(rows(1, **dry, **body), wanted, {"SUBSTEPS": 16.0}, forward=np.full(wanted.shape[1:], 2.0))
    deep = run.q[0, -1] - run.link[0, -1] - 1e-3
    assert 1e4 * deep * np.sqrt(deep / 1e-4) == pytest.approx(2.0, rel=1e-3)
    assert run.link[0, -1] == pytest.approx(2.0 / 1e3, rel=1e-3)


def test_a_stiff_transmission_is_a_rigid_one() -> None:
    wanted = motion.desired(np.random.default_rng(3), 2)[:, :, 18000:30000]
    controlled = [{**row, "KP": 300.0, "KD": 15.0, "OBSERVER": 250.0} for row in rows(2)]
    rigid = simulate(controlled, wanted)
    stiff = simulate(
        [{**row, "STIFFNESS": 1e6, "STIFFNESS_DAMPING": 50.0} for row in controlled], wanted, {"SUBSTEPS": 64.0}
    )
    # A torque of 10 N m turns the spring by 1e-5 rad.
    assert np.abs(rigid.q - stiff.q).max() < 2e-4
    assert np.abs(stiff.q - stiff.link).max() < 3e-5


def test_a_gap_carries_nothing_until_it_is_crossed() -> None:
    wanted = still(1, 0.05)
    push = np.full(wanted.shape[1:], 0.5)
    free = rows(1, **FRICTIONLESS, STIFFNESS=1e4, GAP=0.2)
    run = simulate(free, wanted, forward=push)
    rotor = ARMS[1][0].rotor
    assert np.all(run.link[0, run.q[0] < 0.0999] == 0.0)
    assert run.q[0, 40] == pytest.approx(0.5 * (0.5 / rotor) * run_time(40) ** 2, rel=1e-9)


def run_time(sample: int) -> float:
    return sample * PERIOD


@pytest.mark.parametrize("late", [0.4e-3, 1e-3, 2.7e-3])
def test_a_delay_moves_the_torque_by_just_that_time(late: float) -> None:
    """With inertia alone, the impulse at the end is that of the commands less what has not arrived."""
    wanted = still(1, 0.02)
    push = np.zeros(wanted.shape[1:])
    push[0, 5:] = 1.0
    now, then = (simulate(rows(1, **FRICTIONLESS, DELAY=d), wanted, forward=push) for d in (0.0, late))
    gained = [np.sum(r.acceleration[0]) * PERIOD for r in (now, then)]
    inertia = 0.1 + 0.0565 + 2.0 * 0.2**2
    assert inertia * (gained[0] - gained[1]) == pytest.approx(late, rel=1e-9)


def test_a_bristle_is_a_spring_at_first_and_its_level_at_last() -> None:
    wanted = still(1, 3.0)
    light = rows(1, VISCOUS_POSITIVE=0.0, CUBIC=0.0, BRISTLE=500.0, BRISTLE_DAMPING=20.0)
    run = simulate(light, wanted, forward=np.full(wanted.shape[1:], 0.02))
    assert run.q[0, -1] == pytest.approx(0.02 / 500.0, rel=0.02)
    body = ARMS[1][0]
    controlled = [{**light[0], "KP": 300.0, "KD": 15.0, "OBSERVER": 250.0}]
    wanted[0, 0] = 0.3 * run_time(1) * np.arange(wanted.shape[-1])
    wanted[1, 0] = 0.3
    sliding = simulate(controlled, wanted).tau[0, -500:].mean()
    assert sliding == pytest.approx(body.dry[0], rel=0.01)


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_the_command_is_inverse_dynamics_by_another_method(n: int) -> None:
    setting = cases.Setting(joints=n)
    rng = np.random.default_rng(n)
    specimen = cases.specimen(ARMS[n], BELIEVED, rng)
    made = cases.bench(setting, motion.desired(rng, n), rng, False, specimen)
    run = made.run([])
    middle = run.q + 0.5 * PERIOD * run.rate
    columns = inertial_columns(ARMS[n], middle, run.rate, run.acceleration, (0.0, 0.0))
    left = run.tau + made.background - np.einsum("ikt,k->it", columns, inertial_values(ARMS[n]))
    for i, row in enumerate(made.rows):
        left[i] -= row["DRY_POSITIVE"] * run.above[i] - row["DRY_NEGATIVE"] * run.below[i]
        left[i] -= row["VISCOUS_POSITIVE"] * run.rate[i] + row["CUBIC"] * run.rate[i] ** 3
    # Means over a period against products of means: the period squared over the motion's shortest times squared.
    assert np.sqrt(np.mean(left**2)) < 1e-4


def test_an_effect_has_the_size_that_was_wanted() -> None:
    (case,) = cases.cases(["stribeck"], [1], [0.5], [11], cases.Setting())
    made = cases.make(case)
    assert made.sizes[0] == pytest.approx(0.5, rel=1.1 * cases.NEAR)
    again = cases.make(case)
    assert np.array_equal(made.recording.tau, again.recording.tau)
    assert np.array_equal(made.recording.q, again.recording.q)


def test_every_parameter_that_an_entry_sets_is_one_of_the_plant() -> None:
    known = set(names("parameter"))
    rng = np.random.default_rng(0)
    wanted = motion.desired(rng, 2)
    from .hidden import Setup

    for name, entry in ENTRIES.items():
        hidden = entry.draw(Setup(ARMS[2], 0, wanted, rng))
        found: list[dict[str, float]] = [{}, {}]
        if hidden.put is not None:
            hidden.put(found, {}, hidden.amount)
        assert set(found[0]) | set(found[1]) <= known, name
        assert (hidden.put is None) != (hidden.push is None)


# loads that arms have ------------------------------------------------------------------------------------------------


GEARED = {"GEAR_INERTIA": 0.05, "GEAR_RATIO": -0.7}


def falling(**more: float) -> tuple[Array, Array, Array]:
    """Energy and coupled rate of a falling arm of two joints whose first row has more, and the times."""
    gravity = (0.0, -9.81)
    loose = rows(2, **FRICTIONLESS)
    run = simulate([{**loose[0], **GEARED, **more}, loose[1]], still(2, 3.0), {"GRAVITY_Y": gravity[1]})
    rate = np.gradient(run.q, PERIOD, axis=1)
    coupled = rate[0] + GEARED["GEAR_RATIO"] * rate[1]
    total = energy(2, run.q, rate, gravity) + 0.5 * GEARED["GEAR_INERTIA"] * coupled**2
    return total[5:-5], coupled[5:-5], np.linspace(0.0, 3.0 - PERIOD, len(total))[5:-5]


def test_a_coupled_gear_keeps_the_energy_without_friction() -> None:
    total, coupled, _ = falling()
    exchanged = 0.5 * GEARED["GEAR_INERTIA"] * np.max(coupled**2)
    assert exchanged > 0.5
    assert np.abs(total - total[0]).max() < 1e-2 * exchanged


def test_a_coupled_gear_takes_the_power_of_its_frictions() -> None:
    total, coupled, t = falling(GEAR_DRY=0.3, GEAR_VISCOUS=0.2)
    power = 0.3 * np.abs(coupled) + 0.2 * coupled**2
    taken = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1]) * np.diff(t))])
    assert taken[-1] > 1.0
    assert np.abs(total[0] - total - taken).max() < 1e-2 * taken[-1]


def slipped(speed: float) -> tuple[Array, Array]:
    """Angle and friction of Maxwell slip while the joint goes forwards, and back again."""
    leg = round(0.4 / speed / PERIOD)
    wanted = np.zeros((3, 1, 2 * leg))
    wanted[0, 0] = np.concatenate([np.arange(leg), np.arange(leg)[::-1]]) * PERIOD * speed
    wanted[1, 0] = np.repeat([speed, -speed], leg)
    slip = {"BRISTLE": 60.0, "BRISTLE_FORM": 1.0}
    body = rows(1, VISCOUS_POSITIVE=0.0, VISCOUS_NEGATIVE=0.0, CUBIC=0.0, **slip)[0]
    run = simulate([{**body, "KP": 900.0, "KD": 40.0, "OBSERVER": 400.0}], wanted)
    inertia = 0.1 + 0.0565 + 2.0 * 0.2**2
    friction = run.tau[0] - inertia * run.acceleration[0]
    back = slice(leg + round(0.02 / speed / PERIOD), None)
    return run.q[0, back][::-1], friction[back][::-1]


def test_maxwell_slip_depends_on_the_way_and_not_on_the_rate() -> None:
    slow, fast = slipped(0.1), slipped(0.4)
    at = np.linspace(0.05, 0.37, 60)
    a, b = (np.interp(at, *curve) for curve in (slow, fast))
    assert np.ptp(a) > 0.5 * ARMS[1][0].dry[1]
    assert np.abs(a - b).max() < 0.03 * ARMS[1][0].dry[1]


PACK = {"PACK": 300.0, "PACK_RADIUS": 0.1, "PACK_POST": 0.3, "PACK_FREE": 0.21, "PACK_AT": 0.2}
HOSE = {"HOSE": 0.2, "HOSE_WIDTH": 0.3, "HOSE_AT": -0.1}
LINES = {"RIPPLE": 0.3, "RIPPLE_ORDER": 18.0, "LINE_B": 0.2, "LINE_B_ORDER": 72.0, "LINE_C": 0.1, "LINE_C_ORDER": 144.0}


def stretched(q: float) -> float:
    """Energy of PACK's spring."""
    a, b = np.array([PACK["PACK_RADIUS"], 0.0]), PACK["PACK_POST"] * np.array([np.cos(q - 0.2), -np.sin(q - 0.2)])
    return float(0.5 * PACK["PACK"] * max(0.0, float(np.linalg.norm(a - b)) - PACK["PACK_FREE"]) ** 2)


@pytest.mark.parametrize(
    ("law", "torque"),
    [
        (PACK, lambda q: (stretched(q + 1e-6) - stretched(q - 1e-6)) / 2e-6),
        (HOSE, lambda q: 0.2 * np.sinh((q + 0.1) / 0.3)),
        (LINES, lambda q: 0.3 * np.cos(18 * q) + 0.2 * np.cos(72 * q) + 0.1 * np.cos(144 * q)),
    ],
)
@pytest.mark.parametrize("place", [-0.6, 0.25, 0.9])
def test_a_loose_link_is_pulled_as_the_law_says(
    law: dict[str, float], torque: Callable[[float], float], place: float
) -> None:
    run = simulate(rows(1, **FRICTIONLESS, **law), still(1, 0.01, place), {"SUBSTEPS": 64.0})
    inertia = 0.1 + 0.0565 + 2.0 * 0.2**2
    assert inertia * run.acceleration[0, 0] == pytest.approx(-torque(place), rel=1e-2, abs=1e-3)


@pytest.mark.parametrize("push", [-30.0, 12.0])
def test_a_cubic_saturation_leaves_the_torque_whose_cube_is_missing(push: float) -> None:
    wanted = still(1, 0.01)
    limited = rows(1, **FRICTIONLESS, LIMIT=10.0, LIMIT_FORM=4.0)
    run = simulate(limited, wanted, forward=np.full(wanted.shape[1:], push))
    torque = (0.1 + 0.0565 + 2.0 * 0.2**2) * run.acceleration[0, 0]
    assert torque + torque**3 / (3 * 10.0**2) == pytest.approx(push, rel=1e-6)

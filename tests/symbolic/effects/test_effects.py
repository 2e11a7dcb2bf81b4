"""The library's laws: units, symmetries, dissipation, limits and what the paper says about them."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import sympy as sp
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from si_units import exponents

from symbolic import units as u
from symbolic.effects import DECLARED, LIBRARY
from symbolic.effects.declaration import DT, SIGNAL, SIGNALS, Effect, check, parameter, prefix
from symbolic.primitives import WIDTHS, ramp, sgn, smooth, step
from tests.effect_values import Values, evaluate, torque

# DESIGN's table: other programs use these names.
TABLE = {
    "coulomb": "torque",
    "coulomb_asymmetric": "positive negative",
    "viscous": "coefficient",
    "viscous_asymmetric": "positive negative",
    "viscous_cubic": "coefficient",
    "viscous_power": "torque exponent",
    "stribeck": "torque speed",
    "velocity_strengthening": "torque speed",
    "load_friction": "coefficient",
    "friction_patch": "torque start end",
    "lugre": "stiffness damping",
    "thermal_friction": "coulomb viscous time_constant",
    "offset": "torque",
    "linear_spring": "stiffness rest",
    "parallel_spring": "stiffness radius offset pretension",
    "cable": "c1 c2 c3 c4",
    "end_stop": "position stiffness damping side",
    "spring_hysteresis": "torque width",
    "torque_ripple": "order amplitude phase",
    "torque_saturation": "coefficient exponent",
    "torque_scale": "factor",
    "torque_delay": "time",
    "command_delay": "time",
    "torque_lag": "time_constant",
    "command_lag": "time_constant",
    "elasticity": "stiffness damping",
    "backlash": "gap stiffness damping",
    "gravity": "gx gy",
    "payload": "mass time",
    "coupled_friction": "torque",
    "coupled_gear": "coulomb viscous inertia ratio",
    "plate": "stiffness pretension friction position",
    "plate_damping": "coefficient",
}
IN_SPACE = {name: effect for name, effect in DECLARED.items() if effect != LIBRARY[name]}
EVERY = LIBRARY | {f"{name} in space": effect for name, effect in IN_SPACE.items()}
EFFECTS = pytest.mark.parametrize("effect", EVERY.values(), ids=EVERY)
LEVEL = SIGNAL["level"].symbol
QD = SIGNAL["qd"].symbol
# Sums of a handful of terms of order 1 to 1e3, and exponentials of arguments up to 1e2.
CLOSE = {"rel_tol": 1e-9, "abs_tol": 1e-12}


POSITIVE = ("t", "link_inertia", "level", "ratio", "unmeasured")


@cache
def read(effect: Effect) -> frozenset[sp.Symbol]:
    """Symbols of the effect's laws."""
    laws = (effect.torque, *(law for s in effect.states for law in (s.step, s.initial)))
    return frozenset().union(*(sp.sympify(law).free_symbols for law in laws))


@st.composite
def situations(draw: st.DrawFn, effect: Effect) -> dict[sp.Symbol, float]:
    """A value for every signal that is read, parameter and state, within bounds and away from overflow."""
    number = st.floats(0.1, 3.0)
    signed = st.builds(lambda x, s: x * s, number, st.sampled_from([-1.0, 1.0]))
    values = {DT: draw(st.floats(1e-4, 1e-2))}
    for s in SIGNALS:
        if s.symbol in read(effect):
            values[s.symbol] = draw(number if s.name in POSITIVE else signed)
    if SIGNAL["has_next"].symbol in values:
        values[SIGNAL["has_next"].symbol] = draw(st.sampled_from([0.0, 1.0]))
    for p in effect.parameters:
        values[p.symbol] = draw(st.floats(max(0.1, p.bounds[0]), 3.0) if p.bounds[0] >= 0 else signed)
    if effect.name == "end_stop":
        values[parameter("side")] = draw(st.sampled_from([-1.0, 1.0]))
    return values | {s.symbol: draw(signed) for s in effect.states}


def test_the_library_has_the_names_that_other_programs_use() -> None:
    assert {name: " ".join(p.name for p in e.parameters) for name, e in LIBRARY.items()} == TABLE
    assert list(LIBRARY) == list(TABLE)


def test_an_arm_in_space_has_more_parameters_and_a_planar_one_the_same_torque_where_they_are_zero() -> None:
    names = {n: " ".join(p.name for p in e.parameters if p.space) for n, e in DECLARED.items()}
    assert {name: more for name, more in names.items() if more} == {"gravity": "gz", "payload": "x y z"}
    assert set(IN_SPACE) == {"gravity", "payload"}
    for name, effect in IN_SPACE.items():
        zero = {p.symbol: 0 for p in effect.parameters if p.space}
        assert sp.expand(effect.torque.subs(zero) - LIBRARY[name].torque) == 0
        assert LIBRARY[name].form is None


def test_what_reads_a_signal_of_space_is_no_effect_of_a_planar_arm() -> None:
    lost = replace(LIBRARY["gravity"], torque=parameter("gx") * SIGNAL["moment_z"].symbol)
    with pytest.raises(ValueError, match='"gravity" reads moment_z, which only a spatial arm has'):
        lost.in_plane()


@settings(max_examples=20, deadline=None)
@given(
    st.floats(0.1, 5.0),
    st.tuples(*3 * [st.floats(-0.5, 0.5)]),
    st.tuples(*3 * [st.floats(-3.0, 3.0)]),
    st.tuples(*3 * [st.floats(-3.0, 3.0)]),
)
def test_a_payload_in_space_is_a_point_at_its_centre(
    mass: float, centre: tuple[float, ...], there: tuple[float, ...], turned: tuple[float, ...]
) -> None:
    """The work on a velocity v + w x c of its own frame: two routes to one number."""
    rate = [v + w for v, w in zip(there, np.cross(turned, centre), strict=True)]
    # Of a unit mass at c the kinetic energy is a quadratic form of c: its coefficients stand for the torques.
    wx, wy, wz = turned
    loads = {
        "": sum(v * v for v in there),
        **{axis: 2 * s for axis, s in zip("xyz", np.cross(there, turned), strict=True)},
        "xx": wy**2 + wz**2,
        "yy": wx**2 + wz**2,
        "zz": wx**2 + wy**2,
        "xy": -2 * wx * wy,
        "xz": -2 * wx * wz,
        "yz": -2 * wy * wz,
    }
    read = {f"tip_load{'_' if part else ''}{part}": float(value) for part, value in loads.items()}
    values = {"mass": mass, "time": 0.0, **dict(zip("xyz", centre, strict=True))}
    found = torque("payload", values, DECLARED, elapsed=1.0, **read)
    assert found == pytest.approx(mass * sum(v * v for v in rate), abs=1e-9)


@EFFECTS
def test_declaration_is_consistent_and_reads_well(effect: Effect) -> None:
    check(effect)
    for sentence in (effect.summary, effect.trace, effect.experiment):
        assert sentence[0].isupper()
        assert sentence.endswith(".")
    for text in (effect.equation, effect.source, *(p.meaning for p in effect.parameters)):
        assert text
        assert "\n" not in text
    assert all(name in LIBRARY for name in effect.generalises)


@EFFECTS
@pytest.mark.parametrize("joint_type", ["revolute", "prismatic"])
@settings(max_examples=15, deadline=None)
@given(data=st.data())
def test_units(effect: Effect, joint_type: str, data: st.DataObject) -> None:
    """The same situation in other units of mass, length, time and temperature gives the same torque and states."""
    values = data.draw(situations(effect))
    base = [data.draw(st.floats(0.5, 2.0)) for _ in range(4)]

    def scale(unit: u.Unit) -> float:
        return math.prod(b ** float(power) for b, power in zip(base, exponents(unit, joint_type), strict=True))

    units = {s.symbol: s.unit for s in (*SIGNALS, *effect.parameters, *effect.states)} | {DT: u.SECOND}
    other = {symbol: value * scale(units[symbol]) for symbol, value in values.items()}
    if effect.name == "viscous_power":
        # Its torque is the one at the unit of rate, so it changes with that unit, too.
        other[parameter("torque")] /= scale(u.RATE) ** values[parameter("exponent")]
    results = [(effect.torque, u.FORCE), *((s.step, s.unit) for s in effect.states)]
    results += [(s.initial, s.unit) for s in effect.states]
    for expr, unit in results:
        # Constants that keep quotients finite have no unit: 1e-9 N m of level, 1e-7 rad/s, where all else cancels. A
        # damping times a rate multiplies such a quotient.
        levels = [abs(read[LEVEL]) for read in (values, other) if read.get(LEVEL)]
        times = max(1.0, *(abs(read.get(parameter("damping"), 0.0) * read.get(QD, 0.0)) for read in (values, other)))
        near = 4e-9 * times * max(1.0, scale(unit)) * max([1.0, *(1 / level for level in levels)])
        assert math.isclose(evaluate(expr, other), evaluate(expr, values) * scale(unit), rel_tol=1e-6, abs_tol=near)


@EFFECTS
@settings(max_examples=20, deadline=None)
@given(data=st.data())
def test_regressor_and_form_give_the_torque(effect: Effect, data: st.DataObject) -> None:
    values = data.draw(situations(effect))
    there = effect.form.from_parameters if effect.form else [p.symbol for p in effect.linear]
    coefficients = [evaluate(sp.sympify(c), values) for c in there]
    rows = [evaluate(sp.sympify(c), values) for c in (effect.fixed, *effect.columns)]
    total = rows[0] + sum(r * c for r, c in zip(rows[1:], coefficients, strict=True))
    assert math.isclose(total, evaluate(effect.torque, values), **CLOSE)
    if effect.form:
        for law, value in zip(effect.form.from_parameters, coefficients, strict=True):
            assert math.isclose(from_json(prefix(law), values), value, **CLOSE)
        known = values | {c.symbol: x for c, x in zip(effect.form.coefficients, coefficients, strict=True)}
        for p, back in zip(effect.linear, effect.form.recover, strict=True):
            assert math.isclose(from_json(prefix(back), known), values[p.symbol], **CLOSE)
            assert math.isclose(evaluate(back, known), values[p.symbol], **CLOSE)


def from_json(tree: object, values: Values) -> float:
    """An independent reading of what effects.json says about a form."""
    if isinstance(tree, str):
        return values[parameter(tree)]
    if isinstance(tree, float):
        return tree
    assert isinstance(tree, list)
    arguments = [from_json(a, values) for a in tree[1:]]
    of_one = {"cos": math.cos, "sin": math.sin}
    if tree[0] in of_one:
        return of_one[tree[0]](*arguments)
    operators = {"add": math.fsum, "mul": math.prod, "pow": lambda a: a[0] ** a[1], "atan2": lambda a: math.atan2(*a)}
    return operators[tree[0]](arguments)


def test_prefix_refuses_what_the_reader_of_the_json_does_not_know() -> None:
    with pytest.raises(ValueError, match="exp cannot stand in the form"):
        prefix(sp.exp(parameter("x")))


@cache
def narrow(effect: Effect) -> sp.Expr:
    """The torque's surrogate, of hardly any width."""
    return smooth(effect.torque).subs(dict.fromkeys(WIDTHS, sp.Float(1e-9)))


@EFFECTS
@settings(max_examples=15, deadline=None)
@given(data=st.data())
def test_surrogate_is_exact_away_from_switching(effect: Effect, data: st.DataObject) -> None:
    values = data.draw(situations(effect))
    switches = effect.torque.atoms(sgn, step, ramp)
    assume(all(abs(evaluate(s.args[0], values)) > 1e-6 for s in switches))
    assert math.isclose(evaluate(narrow(effect), values), evaluate(effect.torque, values), rel_tol=1e-6, abs_tol=1e-7)


@pytest.mark.parametrize("name", [n for n, e in LIBRARY.items() if e.dissipates and e.scope == "joint"])
@settings(max_examples=60, deadline=None)
@given(data=st.data(), rate=st.floats(-5, 5))
def test_friction_dissipates(name: str, data: st.DataObject, rate: float) -> None:
    effect = LIBRARY[name]
    values = data.draw(situations(effect)) | {SIGNAL["qd"].symbol: rate}
    assert evaluate(effect.torque, values) * rate >= 0


@settings(max_examples=60, deadline=None)
@given(inner=st.floats(-3, 3), outer=st.floats(-3, 3), size=st.floats(0, 5))
def test_coupled_friction_acts_on_both_joints_and_dissipates(inner: float, outer: float, size: float) -> None:
    first = torque("coupled_friction", {"torque": size}, qd=inner, qd_next=outer, qd_previous=9.0, has_next=1)
    second = torque("coupled_friction", {"torque": size}, qd=outer, qd_next=9.0, qd_previous=inner, has_next=0)
    assert first == second
    assert first * inner + second * outer >= -1e-12 * size


@settings(max_examples=60, deadline=None)
@given(
    rates=st.tuples(st.floats(-3, 3), st.floats(-3, 3)),
    accelerations=st.tuples(st.floats(-9, 9), st.floats(-9, 9)),
    size=st.tuples(*[st.floats(0, 5)] * 3),
    ratio=st.sampled_from([1.0, -1.0, 0.6]),
)
def test_coupled_gear_takes_of_both_joints_what_its_motor_takes(
    rates: tuple[float, float], accelerations: tuple[float, float], size: tuple[float, float, float], ratio: float
) -> None:
    values = {**dict(zip(("coulomb", "viscous", "inertia"), size, strict=True)), "ratio": ratio}
    (v, w), (a, b) = rates, accelerations
    outer = {"qd": v, "qd_next": w, "qd_previous": 9.0, "qdd": a, "qdd_next": b, "qdd_previous": 9.0, "has_next": 1.0}
    inner = {"qd": w, "qd_next": 9.0, "qd_previous": v, "qdd": b, "qdd_next": 9.0, "qdd_previous": a, "has_next": 0.0}
    power = torque("coupled_gear", values, **outer) * v + torque("coupled_gear", values, **inner) * w
    motor = v + ratio * w
    friction = size[0] * abs(motor) + size[1] * motor**2
    assert power == pytest.approx(friction + size[2] * motor * (a + ratio * b), abs=1e-9)


def test_coupled_gear_of_dry_friction_alone_is_coupled_friction() -> None:
    at = {"qd": 0.3, "qd_next": -0.5, "qd_previous": 9.0, "qdd": 1.0, "qdd_next": 2.0, "qdd_previous": 9.0}
    values = {"coulomb": 0.7, "viscous": 0.0, "inertia": 0.0, "ratio": 1.0}
    friction = {k: v for k, v in at.items() if not k.startswith("qdd")}
    assert torque("coupled_gear", values, has_next=1.0, **at) == torque(
        "coupled_friction", {"torque": 0.7}, has_next=1.0, **friction
    )


@settings(max_examples=60, deadline=None)
@given(y=st.floats(-1, 1), rate=st.floats(-3, 3), row=st.floats(-1, 1))
def test_plate_damping_dissipates_in_contact_only(y: float, rate: float, row: float) -> None:
    arguments = {"tip_y": y, "tip_yd": row * rate, "tip_row": row}
    pressed = torque("plate_damping", {"coefficient": 3.0}, plate_y=0.2, **arguments)
    assert pressed * rate >= 0
    assert pressed == 0 or y < 0.2
    assert torque("plate_damping", {"coefficient": 3.0}, plate_y=-math.inf, **arguments) == 0


ODD_IN_RATE = [
    "coulomb",
    "viscous",
    "viscous_cubic",
    "viscous_power",
    "stribeck",
    "velocity_strengthening",
    "load_friction",
    "friction_patch",
]
ODD_IN_RATE += ["thermal_friction"]


@pytest.mark.parametrize("name", ODD_IN_RATE)
@settings(max_examples=20, deadline=None)
@given(data=st.data())
def test_symmetric_friction_is_odd_in_the_rate(name: str, data: st.DataObject) -> None:
    values = data.draw(situations(LIBRARY[name]))
    mirrored = values | {SIGNAL["qd"].symbol: -values[SIGNAL["qd"].symbol]}
    assert evaluate(LIBRARY[name].torque, mirrored) == -evaluate(LIBRARY[name].torque, values)
    assert evaluate(LIBRARY[name].torque, values | {SIGNAL["qd"].symbol: 0.0}) == 0


@pytest.mark.parametrize("name", ["coulomb_asymmetric", "viscous_asymmetric", "end_stop", "linear_spring"])
@settings(max_examples=20, deadline=None)
@given(data=st.data())
def test_mirrored_joint_has_mirrored_torque(name: str, data: st.DataObject) -> None:
    values = data.draw(situations(LIBRARY[name]))
    turned = {SIGNAL[s].symbol for s in ("q", "qd")}
    mirrored = {symbol: -value if symbol in turned else value for symbol, value in values.items()}
    for p in ("position", "side", "rest"):
        if parameter(p) in values:
            mirrored[parameter(p)] = -values[parameter(p)]
    if name.endswith("asymmetric"):
        mirrored[parameter("positive")] = values[parameter("negative")]
        mirrored[parameter("negative")] = values[parameter("positive")]
    assert evaluate(LIBRARY[name].torque, mirrored) == -evaluate(LIBRARY[name].torque, values)


def test_load_friction_counts_the_load_not_its_sign() -> None:
    assert torque("load_friction", {"coefficient": 0.1}, load=-4.0, qd=2.0) == pytest.approx(0.4)
    assert torque("load_friction", {"coefficient": 0.1}, load=4.0, qd=-2.0) == pytest.approx(-0.4)


def test_generalisations_contain_their_special_cases() -> None:
    for rate in (-2.0, -0.1, 0.3, 4.0):
        both = {"positive": 1.3, "negative": 1.3}
        assert torque("coulomb_asymmetric", both, qd=rate) == torque("coulomb", {"torque": 1.3}, qd=rate)
        assert torque("viscous_asymmetric", both, qd=rate) == torque("viscous", {"coefficient": 1.3}, qd=rate)
        power = torque("viscous_power", {"torque": 1.3, "exponent": 1.0}, qd=rate)
        # The rate that keeps the power finite at rest is 1e-9 rad/s.
        assert power == pytest.approx(torque("viscous", {"coefficient": 1.3}, qd=rate), abs=2e-9)


def test_power_law_is_not_searched_where_it_is_viscous_friction() -> None:
    grid = LIBRARY["viscous_power"].parameters[1].grid
    assert grid is not None
    values = [grid.low + k * (grid.high - grid.low) / (grid.count - 1) for k in range(grid.count)]
    assert min(abs(v - 1) for v in values) > 0.04


def test_thermal_friction_reads_a_temperature_or_assumes_one_kelvin() -> None:
    parameters = {"coulomb": -0.2, "viscous": -0.1, "time_constant": 100.0}
    measured = torque("thermal_friction", parameters, qd=2.0, t=5.0, warmth=10.0, unmeasured=0.0)
    assert measured == pytest.approx(10 * (-0.2 - 0.1 * 2))
    late = torque("thermal_friction", parameters, qd=2.0, t=1e5, warmth=0.0, unmeasured=1.0)
    assert late == pytest.approx(-0.2 - 0.1 * 2)


# --- what the paper says -------------------------------------------------------------------------------------------

TABLE_I = {1: (1.46, 0.83, 2.53, -0.21, 2.0), 2: (1.14, 0.91, 2.18, -0.19, 2.0)}
TABLE_I |= {3: (1.01, 1.14, 1.93, -0.12, 2.5), 4: (1.72, 1.05, 1.14, -0.015, 5.0)}


def table_friction(joint: int, rate: float) -> float:
    positive, negative, linear, cubic, _ = TABLE_I[joint]
    return (
        torque("coulomb_asymmetric", {"positive": positive, "negative": negative}, qd=rate)
        + torque("viscous", {"coefficient": linear}, qd=rate)
        + torque("viscous_cubic", {"coefficient": cubic}, qd=rate)
    )


@pytest.mark.parametrize("joint", TABLE_I)
@settings(max_examples=40, deadline=None)
@given(part=st.floats(-1, 1))
def test_table_1_dissipates_over_its_identified_range(joint: int, part: float) -> None:
    rate = part * TABLE_I[joint][4]
    assert table_friction(joint, rate) * rate >= 0


@pytest.mark.parametrize("joint", [1, 2])
@pytest.mark.parametrize("direction", [1, -1])
def test_table_1_turns_active_near_3_6_rad_per_s(joint: int, direction: int) -> None:
    # The four crossings are at 3.58 to 3.73 rad/s; the notes round them to 3.6.
    assert table_friction(joint, direction * 3.45) * direction > 0
    assert table_friction(joint, direction * 3.75) * direction < 0


@settings(max_examples=60, deadline=None)
@given(q=st.floats(-2, 1))
def test_parallel_spring_is_equation_2_with_a_minus(q: float) -> None:
    radius, stiffness, offset, tension = 0.06, 5100.0, -0.2, 30.0
    tau_s = radius**2 * stiffness * (offset - q) + radius * tension if q < offset else 0.0
    parameters = {"stiffness": stiffness, "radius": radius, "offset": offset, "pretension": tension}
    assert torque("parallel_spring", parameters, q=q) == pytest.approx(-tau_s, rel=1e-12, abs=1e-12)


@settings(max_examples=60, deadline=None)
@given(y=st.floats(0, 1), yd=st.floats(-1, 1), row=st.floats(-1, 1))
def test_plate_is_equation_3_through_the_jacobian(y: float, yd: float, row: float) -> None:
    y_p, sign = 0.54, (yd > 0) - (yd < 0)
    force = 24.0 + 686.0 * (y_p - y) - 3.0 * sign if y < y_p else 0.0
    parameters = {"stiffness": 686.0, "pretension": 24.0, "friction": 3.0, "position": y_p}
    assert torque("plate", parameters, tip_y=y, tip_yd=yd, tip_row=row) == pytest.approx(-row * force, abs=1e-9)


def test_gravity_and_payload_have_the_model_s_sign() -> None:
    # A level arm under gravity along -y needs a positive torque to hold a mass at positive x.
    assert torque("gravity", {"gx": 0.0, "gy": -9.81}, moment_x=0.0, moment_y=2.0) == pytest.approx(19.62)
    assert torque("payload", {"mass": 2.0, "time": 5.0}, elapsed=4.9, tip_load=3.0) == 0
    assert torque("payload", {"mass": 2.0, "time": 5.0}, elapsed=5.1, tip_load=3.0) == 6.0


def test_drive_effects_distort_the_predicted_torque() -> None:
    assert torque("torque_scale", {"factor": 1.1}, predicted=5.0) == pytest.approx(0.5)
    assert torque("torque_saturation", {"coefficient": 0.01, "exponent": 3.0}, predicted=-2.0) == pytest.approx(-0.08)
    # At the inverse root of the coefficient half of what is recorded acts, and a tenth below that nearly all of it.
    hard = {"coefficient": 0.25, "exponent": 15.0}
    assert torque("torque_saturation", hard, predicted=2.0) == pytest.approx(2.0)
    assert torque("torque_saturation", hard, predicted=1.8) == pytest.approx(1.8 * 0.9**14)
    # tau(t) = sin(3 t) recorded 2 ms ahead: sin(3 (t + 0.002)), to second order in 0.006.
    ahead = math.sin(3 * 0.7) + torque("torque_delay", {"time": 0.002}, predicted_rate=3 * math.cos(3 * 0.7))
    assert ahead == pytest.approx(math.sin(3 * 0.702), abs=0.006**2)
    # A ramp that lags by 20 ms behind the recorded one is 20 ms of its slope below it.
    assert torque("torque_lag", {"time_constant": 0.02}, predicted_rate=5.0) == pytest.approx(0.1)


def test_friction_rises_from_rest_to_its_plateau() -> None:
    parameters = {"torque": 0.8, "speed": 0.1}
    assert torque("velocity_strengthening", parameters, qd=1e-6) == pytest.approx(0.0, abs=1e-9)
    assert torque("velocity_strengthening", parameters, qd=0.1) == pytest.approx(0.8 * (1 - 1 / math.e))
    assert torque("velocity_strengthening", parameters, qd=-2.0) == pytest.approx(-0.8)


def test_ripple_repeats_with_the_motor_not_with_the_joint() -> None:
    parameters = {"order": 2.0, "amplitude": 0.4, "phase": 0.3}
    turn = 2 * math.pi / 100
    assert torque("torque_ripple", parameters, q=0.0, ratio=100) == pytest.approx(0.4 * math.cos(0.3))
    for q in (0.1, 0.1 + turn / 2, 0.1 + turn):
        assert torque("torque_ripple", parameters, q=q, ratio=100) == pytest.approx(0.4 * math.cos(20.3))

"""What effects read is the same wherever it is read, and follows from its declaration."""

from __future__ import annotations

import ast
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from codegen.prepare import prepare_arm
from runtime.identification.regressors import Signals
from runtime.model import terms
from runtime.model.loader import Library, Model
from runtime.model.terms import Prediction, Structure, Term
from runtime.motion.piece import Piece
from runtime.planning import physics
from runtime.simulation import equations, simulate
from symbolic.controller_law import Site
from symbolic.effects import LIBRARY
from symbolic.effects.declaration import SIGNAL, SIGNALS, Effect, Signal, parameter
from symbolic.effects.signals import ArmOutput, ArmSlope
from tests.random_arms import MIXED

ROOT = Path(__file__).resolve().parents[3]
SAMPLES = 7
SHARP = 1e-12  # rad/s: a switch so narrow that rates of a tenth are far beyond it


@pytest.fixture(scope="module", params=["r", "rp", "prr", "rrrr"])
def arm(request: pytest.FixtureRequest, library: Library) -> Model:
    return Model(prepare_arm(MIXED[request.param]), library)


def acting(model: Model) -> Structure:
    """Dry friction, a spring and a plate; nothing with a memory."""
    plate = {"stiffness": 800.0, "pretension": 3.0, "friction": 0.5, "position": 0.1}
    found: Structure = {Term("plate"): plate}
    for joint in range(1, model.n + 1):
        found[Term("coulomb_asymmetric", joint)] = {"positive": 0.7, "negative": 0.4}
        found[Term("linear_spring", joint)] = {"stiffness": 2.0, "rest": 0.1}
    return found


def piece(model: Model, warm: bool = False) -> Piece:
    """Random positions, rates of either sign well away from rest, and accelerations; no motion of any arm."""
    rng = np.random.default_rng(model.n)
    shape = (model.n, SAMPLES)
    qd = rng.uniform(0.1, 3.0, shape) * rng.choice([-1.0, 1.0], shape)
    return simulate._prescribed(model.library, rng.uniform(-2, 2, shape), qd, rng.normal(size=shape), 1e3, warm)


def along(model: Model, warm: bool = False) -> Signals:
    return Signals(model, piece(model, warm), Prediction(model.lump_values, acting(model)))


def places(model: Model) -> list[tuple[int, int]]:
    return [(joint, own) for joint in range(model.n) for own in range(model.n)]


def there(model: Model) -> list[Signal]:
    """The signals that an arm has."""
    return [s for s in SIGNALS if model.spatial or not s.space]


def test_numbers_and_expressions_are_the_same(arm: Model) -> None:
    """Of all signals at all joints; the plant's torques are the prediction's when all is known. Signals that only
    spatial arms have come from the arm's functions."""
    assert all(s.source is not None for s in SIGNALS if s.space)
    seen = along(arm)
    known = Prediction(arm.lump_values, acting(arm))
    moved = equations.PlantEquations(arm, known, np.full(arm.n, SHARP))
    q, qd, qdd = (ca.SX.sym(name, arm.n) for name in ("q", "qd", "qdd"))
    t = ca.SX.sym("t")
    at = equations.PlantInstant(q, qd, qdd, t)
    torque = moved.torque(at, ca.SX(0, 1))
    slope = ca.SX.sym("slope")
    for joint, own in places(arm):
        here = equations._Driven(equations._Signals(moved, at), torque[joint], slope)
        read = [here.signal(s.name, joint, own) for s in there(arm)]
        whole = ca.Function("read", [q, qd, qdd, t, slope], [ca.vertcat(*read)])
        p = seen.piece
        rate = np.asarray(seen.signal("predicted_rate", joint, own))
        found = np.array(whole.map(SAMPLES)(p.q, p.qd, p.qdd, p.t[None], rate[None]))
        for s, values in zip(there(arm), found, strict=True):
            expected = np.broadcast_to(seen.signal(s.name, joint, own), SAMPLES)
            close = 1e-7 if isinstance(s.source, ArmSlope) else 1e-9  # which recordings take from differences
            np.testing.assert_allclose(values, expected, rtol=close, atol=close, err_msg=s.name)


def test_a_plan_reads_the_same(arm: Model) -> None:
    seen = along(arm)
    plan = physics.Physics(arm, acting(arm), {})
    values = plan.values(50 * SHARP) | {"struct": arm.struct_values}
    q, qd, qdd = (ca.SX.sym(name, arm.n) for name in ("q", "qd", "qdd"))
    instant = physics.PlanInstant(plan, q, qd, qdd, {}, lambda name: ca.SX(values[name]), apart=False)
    summed = instant.torque
    known = [s for s in there(arm) if s.known_to != "recording"]
    for joint, own in places(arm):
        read = [instant._signals.signal(s.name, joint, own) for s in known]
        whole = ca.Function("read", [q, qd, qdd], [ca.vertcat(*read, summed[joint])])
        p = seen.piece
        *found, torque = np.array(whole.map(SAMPLES)(p.q, p.qd, p.qdd))
        for s, numbers in zip(known, found, strict=True):
            expected = np.broadcast_to(seen.signal(s.name, joint, own), SAMPLES)
            np.testing.assert_allclose(numbers, expected, rtol=1e-9, atol=1e-9, err_msg=s.name)
        np.testing.assert_allclose(torque, seen.predicted(joint), rtol=1e-9, atol=1e-9)


def test_what_a_plan_does_not_know_it_does_not_make_up(arm: Model) -> None:
    plan = physics.Physics(arm, {}, {})
    still = ca.SX.zeros(arm.n)
    instant = physics.PlanInstant(plan, still, still, still, {}, lambda _: ca.SX(0), apart=False)
    for name in ("t", "predicted_rate"):
        with pytest.raises(terms.UnknownHere):
            instant._signals.signal(name, 0, 0)


def test_a_measured_temperature_is_read(arm: Model) -> None:
    cold, warm = along(arm), along(arm, warm=True)
    assert (cold.at("warmth", 0), cold.at("unmeasured", 0)) == (0.0, 1.0)
    assert warm.at("unmeasured", 0) == 0.0
    assert np.ptp(warm.at("warmth", 0)) > 1.0


def test_without_a_model_only_the_motion_is_known(arm: Model) -> None:
    """A signal that does not need an identified model is there before there is one, the same as afterwards."""
    after = along(arm)
    before = Signals(arm, after.piece, None)
    for s in there(arm):
        if s.needs in terms.IDENTIFIED:
            with pytest.raises(RuntimeError, match=f"{s.name} needs an identified model"):
                before.at(s.name, 0)
        else:
            np.testing.assert_array_equal(before.at(s.name, 0), after.at(s.name, 0))


def test_what_touches_nothing_has_no_surface(arm: Model) -> None:
    terms = {term: values for term, values in acting(arm).items() if term.effect != "plate"}
    seen = Signals(arm, piece(arm), Prediction(arm.lump_values, terms))
    torque = arm.library.torque("plate_damping", seen.of(Term("plate_damping"), 0), {"coefficient": 9.0})
    np.testing.assert_array_equal(torque, 0.0)
    assert seen.lacks(Term("plate_damping"))
    assert not along(arm).lacks(Term("plate_damping"))


def reading(name: str) -> Effect:
    """An effect that reads one signal."""
    return replace(LIBRARY["offset"], name="own", torque=parameter("torque") * SIGNAL[name].symbol)


@pytest.mark.parametrize("signal", SIGNALS, ids=lambda s: s.name)
def test_who_can_use_an_effect_follows_from_what_it_reads(signal: Signal) -> None:
    """A controller compensates what it can read at the measured motion; a plan knows that, too, and accelerations."""
    effect = reading(signal.name)
    assert (Site(effect, 1).obstacle is None) == (signal.known_to == "controller")
    assert effect.gives_way == signal.name.startswith("coupling")


@pytest.mark.parametrize("signal", [s for s in SIGNALS if isinstance(s.source, ArmOutput)], ids=lambda s: s.name)
def test_what_is_known_to_a_controller_follows_from_positions_and_rates(signal: Signal, model: Model) -> None:
    assert isinstance(signal.source, ArmOutput)
    inputs = {name for name, _ in model.metadata["functions"][signal.source.function]["inputs"]}
    if signal.known_to == "controller":
        assert inputs <= {"q", "qd"}
        assert signal.needs == "motion"


# --- one place ---

NAMES = frozenset(SIGNAL)
COORDINATES = frozenset({"q", "qd", "qdd", "t"})
"""They are inputs of functions and columns of recordings as well."""
PLACES = (
    "symbolic/effects/",
    "symbolic/described.py",
    "runtime/model/terms.py",
    "symbolic/grammar/",
    "runtime/recordings/",
    "codegen/verify/proof.py",
    "codegen/c/arm_effects.py",
)
"""Where signals are declared, of which quantities a grid may be a part (not all are signals), where those without a
source are read, where laws are made of them, where columns of recordings have their names, where functions are proved
that have the names of signals, and where those without a source are computed in C."""


def strings(nodes: list[ast.expr | None]) -> set[str]:
    return {node.value for node in nodes if isinstance(node, ast.Constant) and isinstance(node.value, str)}


def names_signals(node: ast.AST) -> bool:
    """Whether an expression lists signals, or asks whether one is among those that an effect reads."""
    if isinstance(node, ast.Dict):
        return len(strings(node.keys) & NAMES - COORDINATES) > 1
    if isinstance(node, ast.Set | ast.List | ast.Tuple):
        return len(strings(list(node.elts)) & NAMES - COORDINATES) > 1
    asked = isinstance(node, ast.Compare) and isinstance(node.ops[0], ast.In | ast.NotIn)
    return asked and bool(strings([node.left]) & NAMES)


def test_signals_are_listed_in_one_place() -> None:
    found = []
    for package in ("symbolic", "codegen", "runtime"):
        for path in sorted((ROOT / package).rglob("*.py")):
            place = str(path.relative_to(ROOT))
            if not place.startswith(PLACES):
                nodes = ast.walk(ast.parse(path.read_text(encoding="utf-8")))
                found += [f"{place}:{node.lineno}" for node in nodes if names_signals(node)]
    assert found == []

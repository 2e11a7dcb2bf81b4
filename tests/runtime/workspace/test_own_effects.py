"""A user's own effects get what the library's get: by what they declare, since nothing asks for their names."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from runtime.cli import output
from runtime.cli.main import app
from runtime.diagnosis.candidates import Candidate, FittedBase
from runtime.diagnosis.further_sensors import FurtherSensors
from runtime.diagnosis.gates import failed
from runtime.diagnosis.stages import diagnose
from runtime.identification.identify import identify
from runtime.identification.regressors import Signals
from runtime.model.loader import Model
from runtime.model.terms import Prediction, Term, structure
from runtime.recordings.recording import Recording
from runtime.report.reasons import closed_gates
from runtime.simulation import simulate as simulation
from runtime.simulation.equations import PlantError
from runtime.simulation.options import SimulationSettings
from runtime.simulation.plant import Plant
from runtime.workspace.source import Source
from tests import one_joint
from tests.bench_arm import PLAIN, THERE_AND_BACK
from tests.bench_arm import trajectory as planned
from tests.kept import kept

OWN = """\
from dataclasses import replace
from functools import cache

from symbolic import units as u
from symbolic.effects.declaration import SIGNAL, Effect, Parameter, parameter
from symbolic.effects.springs import LINEAR_SPRING
from symbolic.effects.transmission import BACKLASH
from symbolic.primitives import WIDTH_RATE, sgn

STIFFNESS, REST = LINEAR_SPRING.parameters
EFFECTS = (
    Effect(
        name="felt_pad",
        scope="joint",
        family="of our own",
        torque=parameter("grip") * sgn(SIGNAL["qd"].symbol, WIDTH_RATE),
        parameters=(Parameter("grip", u.FORCE, "of the pad", bounds=(0.0, float("inf"))),),
        summary="A pad of felt that holds the shaft.",
        equation="F sgn(qd)",
        trace="A step at every reversal.",
        experiment="Constant speeds in both directions.",
        source="Our own.",
        dissipates=True,
        dry=True,
    ),
    replace(BACKLASH, name="loose_key", family="of our own"),
    replace(
        LINEAR_SPRING,
        name="torsion_bar",
        family="of our own",
        generalises=(),
        brought=True,
        parameters=(
            replace(STIFFNESS, planned="size", scale=10.0),
            replace(REST, planned="place", says="slack at"),
        ),
    ),
)
"""
SCENARIO = """\
name = "swing"
model = "bench.toml"
cycle_time = 2.0
friction = false
[points.low]
q1 = -1.0
rest = true
[points.high]
q1 = 0.0
rest = true
[[phase]]
from = "low"
to = "high"
part = 0.5
degree = 9
[[phase]]
from = "high"
to = "low"
part = 0.5
degree = 9
[[spring]]
effect = "torsion_bar"
joint = 1
stiffness = [0.0, 20.0]
rest = [-2.0, 1.0]
"""


def _rubbing(effect: str, parameter: str) -> str:
    """The bench with one friction, of 1.5 in SI units."""
    return one_joint.model_text(f"[joint.effects.{effect}]\n{parameter} = 1.5\n", name="bare")


pytestmark = pytest.mark.xdist_group("own effects")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, cache: Path) -> Path:  # noqa: ARG001
    here = tmp_path_factory.mktemp("own")
    (here / "own.py").write_text(OWN)
    (here / "padded.toml").write_text(_rubbing("felt_pad", "grip"))
    (here / "plain.toml").write_text(_rubbing("coulomb", "torque"))
    (here / "slippery.toml").write_text(_rubbing("viscous", "coefficient"))
    (here / "bench.toml").write_text(PLAIN)
    (here / "swing.toml").write_text(SCENARIO)
    return here


@cache
def opened(folder: Path, name: str) -> Model:
    return Source.read(folder / f"{name}.toml", folder / "own.py").compiled.model()


def recorded(model: Model, hidden: str, signals: str = "") -> Recording:
    settings = SimulationSettings(signals=signals)
    return simulation.simulate(model, [simulation.parse_hidden(hidden, model)], settings)[0]


BRISTLE = "lugre@1:stiffness=200,damping=1"


def searched(model: Model, made: Recording) -> Candidate | None:
    """The bristle as a candidate for what a fitted model lacks; None where it is none."""
    fitted = kept(identify, model, [made])
    field = FittedBase(fitted)
    return field.search(Term("lugre", 1)) if Term("lugre", 1) in field.terms() else None


def test_a_dry_friction_of_ones_own_carries_a_bristle(folder: Path) -> None:
    """The recording is that of Coulomb friction of the same height, to the last bit, and so is what is found in it."""
    own, theirs = (recorded(opened(folder, name), BRISTLE) for name in ("padded", "plain"))
    np.testing.assert_array_equal(own.tau, theirs.tau)
    found = [searched(opened(folder, name), theirs) for name in ("padded", "plain")]
    own, theirs = (c and (c.term, c.shape, c.fall, c.edge) for c in found)
    assert own is not None
    assert own == theirs


def test_nothing_carries_a_bristle_where_no_friction_is_dry(folder: Path) -> None:
    assert searched(opened(folder, "slippery"), recorded(opened(folder, "padded"), BRISTLE)) is None


def test_a_bristle_needs_a_friction_that_says_that_it_is_dry(folder: Path) -> None:
    held = {Term("lugre", 1): {"stiffness": 60.0, "damping": 0.1}}
    padded, slippery = opened(folder, "padded"), opened(folder, "slippery")
    Plant(padded, {**structure(padded), **held}, 1e-3)
    with pytest.raises(PlantError, match="replaces the joint's Coulomb friction, which it does not have"):
        Plant(slippery, {**structure(slippery), **held}, 1e-3)


def loose(folder: Path, **declared: object) -> Model:
    """The drive with a library that has no other gap than ours, which may declare something else of itself."""
    source = Source.shipped("drive", folder / "own.py")
    library = {name: effect for name, effect in source.compiled.library.items() if name != "backlash"}
    library["loose_key"] = replace(library["loose_key"], **declared)  # type: ignore[arg-type]
    return replace(source, own=library).compiled.model()


def play(model: Model, made: Recording, gap: float, rest: dict[str, float]) -> list[str]:
    """What a link-side encoder holds against the own gap, if it were this wide."""
    fitted = kept(identify, model, [made])
    sensors = FurtherSensors(FittedBase(fitted))
    candidate = Candidate(Term("loose_key", 1), {**rest, "gap": gap}, 3, 0.0, np.inf, results=())
    closed = failed(sensors._play(candidate))
    return closed_gates(replace(candidate, results=closed), model)


def test_a_gap_of_ones_own_is_witnessed_by_a_link_encoder(folder: Path) -> None:
    """It is found; were it wider than what the encoder shows, that would speak against it. Were it narrower, that is a
    matter of its value, but for an effect that does not say that it has a gap."""
    model = loose(folder)
    hidden = simulation.parse_hidden("loose_key@1", model)
    seen, values = simulation.simulate(model, [hidden], SimulationSettings(signals="q_link"))
    assert seen.q_link is not None
    assert seen.q_desired is not None
    true = values[hidden.term]
    assert np.ptp(seen.q_desired - seen.q_link) > true["gap"]
    findings = kept(diagnose, model, [seen]).findings
    assert [(str(f.term), f.rivals) for f in findings] == [("loose_key@1", ())]
    assert play(model, seen, true["gap"], true) == []
    (wide,) = play(model, seen, 10 * true["gap"], true)
    assert "less play than it has" in wide
    assert play(model, seen, true["gap"] / 100, true) == []
    (silent,) = play(loose(folder, has_gap=False), seen, true["gap"] / 100, true)
    assert "more play than it has" in silent


@pytest.fixture(scope="module")
def swung(folder: Path) -> dict[str, object]:
    monkeypatch = pytest.MonkeyPatch()
    monkeypatch.chdir(folder)
    arguments = ["optimize", "swing.toml", "--effects", "own.py", "--out", "plan.json", "--json", "p.json"]
    assert output.run(app, [*arguments, "--model-out", "sprung.toml"]) == 0
    monkeypatch.undo()
    return json.loads((folder / "p.json").read_text())


def test_a_spring_of_ones_own_is_planned_with(folder: Path, swung: dict[str, object]) -> None:
    """On a bar of its own frequency an arm swings by itself: k = J (2 pi/T)^2, slack in the middle, and no torque."""
    (spring,) = swung["springs"]  # type: ignore[misc]
    assert spring["effect"] == "torsion_bar"
    assert spring["stiffness"] == pytest.approx(one_joint.INERTIA * (2 * np.pi / 2.0) ** 2, rel=0.02)
    assert spring["rest"] == pytest.approx(-0.5, abs=0.02)
    assert spring["text"] == f"stiffness {spring['stiffness']:.4g} N m/rad, slack at {spring['rest']:.4g} rad"
    amplitude = one_joint.INERTIA * (2 * np.pi / 2.0) ** 2 * 0.5
    assert swung["objective"]["value"] < 1e-3 * amplitude**2 / 2 * 2.0  # type: ignore[index]
    assert "[joint.effects.torsion_bar]" in (folder / "sprung.toml").read_text()


def test_a_spring_of_ones_own_is_executed_with(
    folder: Path, swung: dict[str, object], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The controller's C has the law of the bar in it: the arm follows, and its motor gives friction's torque alone."""
    monkeypatch.chdir(folder)
    assert swung["feasible"]
    arguments = ["execute", "bench.toml", "plan.json", "--effects", "own.py", "--on", "simulation", "--trials", "1"]
    assert output.run(app, [*arguments, "--cycles", "2", "--json", "e.json"]) == 0
    done = json.loads((folder / "e.json").read_text())
    assert done["status"] == "done"
    assert {"effect": "torsion_bar", "joint": 1} in [{k: e[k] for k in ("effect", "joint")} for e in done["effects"]]


def test_a_trajectory_names_a_spring_that_is_none(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(folder)
    planned(THERE_AND_BACK, springs={1: {"stiffness": 2.0, "rest": 0.0}}, effects={1: "elasticity"}).write(
        folder / "wrong.json"
    )
    arguments = ["execute", "bench.toml", "wrong.json", "--effects", "own.py", "--on", "simulation"]
    assert output.run(app, arguments) == 2
    said = capsys.readouterr().err
    expected = 'wrong.json: spring 1: effect is "elasticity"; expected one of parallel_spring, torsion_bar'
    assert said.splitlines()[-1] == expected


def test_the_level_is_that_of_all_dry_friction_at_the_joint(folder: Path) -> None:
    model = opened(folder, "padded")
    values = {Term("felt_pad", 1): {"grip": 1.5}, Term("stribeck", 1): {"torque": 0.4, "speed": 1e9}}
    piece = simulation._piece(model.library, 0.3 * np.sin(np.arange(2000) / 100)[None], warm=False)
    level = Signals(model, piece, Prediction(model.lump_values, values)).signal("level", 0, 0)
    np.testing.assert_allclose(level[np.abs(piece.qd[0]) > 1e-3], 1.9)

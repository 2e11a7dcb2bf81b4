"""Scenario files and trajectory files: what is read is what was meant, and every mistake is named in one line."""

from __future__ import annotations

import copy
import json
import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from runtime.model.loader import Library, Model
from runtime.planning import scenario_file, trajectory
from runtime.planning.trajectory import Phase, Trajectory, TrajectoryError
from symbolic.model_file.arm import Limits
from symbolic.model_file.checks import ModelError
from tests.runtime.planning.planning_cases import arm, parsed, there

STUDY = Path(__file__).resolve().parents[3] / "runtime" / "study"
Change = Callable[[dict[str, Any]], object]


@pytest.fixture(scope="module")
def two(library: Library) -> Model:
    return arm(library, "rp", Limits(position=(-1.0, 1.0)))


def table(name: str) -> dict[str, Any]:
    return tomllib.loads((STUDY / f"{name}.toml").read_text(encoding="utf-8"))


# --- scenario files ---


def test_the_studys_files_mean_what_they_say(model: Model) -> None:
    first, second = (
        scenario_file.fitted(scenario_file.read(STUDY / f"{name}.toml"), model, name)
        for name in ("scenario1", "scenario2")
    )
    assert first.moving == (4,)
    assert [phase.degree for phase in first.phases] == [10, 10]
    assert first.points["turn"].q == {4: -np.pi / 2}
    assert [phase.part for phase in second.phases] == [0.4, 0.1, 0.1, 0.4]
    assert [phase.kind for phase in second.phases] == ["free", "contact", "contact", "free"]
    assert second.moving == (1, 2, 3, 4)
    assert not first.without_springs().springs
    assert first.at(2.0).cycle_time == 2.0


SCENARIO_ERRORS: dict[str, tuple[str, Change, str]] = {
    "unknown key": (
        "scenario1",
        lambda t: t.update(cycletime=1.0),
        'unknown key "cycletime"; did you mean "cycle_time"?',
    ),
    "missing key": ("scenario1", lambda t: t.pop("cycle_time"), 'missing key "cycle_time"'),
    "time": ("scenario1", lambda t: t.update(cycle_time=0.0), "cycle_time is 0; expected a number in s >= 0.01"),
    "not finite": (
        "scenario1",
        lambda t: t.update(cycle_time=float("nan")),
        "cycle_time is nan; expected a number in s",
    ),
    "flag": ("scenario1", lambda t: t.update(friction=1), "friction is 1; expected true or false"),
    "elbow": ("scenario2", lambda t: t.update(elbow=2), "elbow is 2; expected 1 or -1, the sign of sin q_2 in contact"),
    "code": (
        "scenario1",
        lambda t: t.update(name="__import__('os')"),
        "name \"__import__('os')\" is no C identifier",
    ),
    "goal": (
        "scenario1",
        lambda t: t["objective"].update(goal="torque"),
        'objective: goal is the text "torque"; expected one of torque_squared, peak_torque, ',
    ),
    "point": (
        "scenario1",
        lambda t: t["phase"][0].update({"to": "trun"}),
        'phase 1: to is the unknown point "trun"; did you mean "turn"?',
    ),
    "point's key": ("scenario1", lambda t: t["points"]["turn"].update(q=1.0), 'points.turn: unknown key "q"'),
    "degree": ("scenario1", lambda t: t["phase"][1].update(degree=2), "phase 2: degree is 2; expected a number >= 3"),
    "half a degree": (
        "scenario1",
        lambda t: t["phase"][1].update(degree=7.5),
        "phase 2: degree is 7.5; expected a whole number",
    ),
    "parts": ("scenario1", lambda t: t["phase"][1].update(part=0.4), "the phases' parts add up to 0.9; expected 1"),
    "order": (
        "scenario1",
        lambda t: t["phase"][1].update({"to": "turn"}),
        'phase 2: ends at "turn", and the next one begins at "home"',
    ),
    "kind": (
        "scenario2",
        lambda t: t["phase"][1].update(kind="touch"),
        'phase 2: kind is the text "touch"; expected "free" or "contact"',
    ),
    "spring's range": (
        "scenario1",
        lambda t: t["spring"][0].update(stiffness=[8000.0, 1300.0]),
        "spring 1: stiffness is [8000, 1300]; expected the smaller bound first",
    ),
    "pushing spring": (
        "scenario1",
        lambda t: t["spring"][0].update(stiffness=[-1.0, 1300.0]),
        "spring 1: stiffness is -1; expected 0 N/m or more",
    ),
    "two springs": (
        "scenario1",
        lambda t: t["spring"].append(copy.deepcopy(t["spring"][0])),
        "two [[spring]] tables for one joint; expected at most one",
    ),
    "no joint": ("scenario1", lambda t: t["spring"][0].update(joint=5), "spring: there is no joint 5; vishard4 has 4"),
    "joint from zero": ("scenario1", lambda t: t.update(moving=[0]), "moving holds 0; expected joints, counted from 1"),
    "posture": ("scenario1", lambda t: t.update(posture=[0.0]), "posture has 1 numbers; vishard4 has 4 joints"),
    "still": (
        "scenario1",
        lambda t: t["points"]["turn"].update(q2=0.3),
        "points.turn: joint 2 does not move; add it to moving, or leave out q2",
    ),
    "ohm": (
        "scenario1",
        lambda t: t["objective"].update(goal="electrical_energy"),
        "objective: resistance has 0 numbers; expected 4, one per joint, in Ohm",
    ),
    "torque constant": (
        "scenario1",
        lambda t: t["objective"].update(goal="electrical_energy", resistance=[1.0] * 4),
        "objective: electrical_energy needs the torque_constant of joint 4 in the model file",
    ),
    "off the axis": (
        "scenario2",
        lambda t: t["points"]["touch"].update(tip=[0.1, t["points"]["touch"]["tip"][1]]),
        "points.touch: tip has x = 0.1 m; in contact it is the plate's",
    ),
    "no tip": (
        "scenario2",
        lambda t: t["points"]["touch"].pop("tip"),
        "points.touch: contact phase 2 begins or ends here; expected a tip",
    ),
    "all move": (
        "scenario2",
        lambda t: t.update(moving=[1, 2, 3]),
        "moving: in a contact phase all joints move; leave moving out",
    ),
    "no such contact": (
        "scenario2",
        lambda t: t["contact"].update(wall={"stiffness": 1.0}),
        "contact.wall: vishard4 has no such effect at its contact; it has plate",
    ),
    "plate's parameter": (
        "scenario2",
        lambda t: t["contact"]["plate"].update(stifness=1.0),
        'contact.plate: unknown parameter "stifness"; did you mean "stiffness"?',
    ),
}


@pytest.mark.parametrize("what", SCENARIO_ERRORS)
def test_a_mistake_in_a_scenario_is_named(model: Model, what: str) -> None:
    name, change, message = SCENARIO_ERRORS[what]
    document = table(name)
    change(document)
    with pytest.raises(ModelError) as told:
        parsed(model, document)
    assert str(told.value).startswith(f"test.toml: {message}")
    assert "\n" not in str(told.value)


def test_every_key_of_a_scenario_is_listed_with_what_it_means() -> None:
    rows = {row.key: row for row in scenario_file.scenario_file_rows()}
    named = {"points": "NAME", "contact": "EFFECT.PARAMETER"}

    def keys(document: Any, prefix: str = "") -> list[str]:
        if isinstance(document, list) and document and isinstance(document[0], dict):
            return [key for item in document for key in keys(item, prefix)]
        if not isinstance(document, dict):
            own = re.sub(r"^spring\.(?!joint$|effect$|catalogue$).*", "spring.PARAMETER", prefix)
            return [re.sub(r"\bq\d$", "q1", own)]
        if prefix in named:
            inner = f"{prefix}.{named[prefix]}"
            return [inner] if "." in named[prefix] else [k for item in document.values() for k in keys(item, inner)]
        return [k for name, item in document.items() for k in keys(item, f"{prefix}.{name}".lstrip("."))]

    assert {key for name in ("scenario1", "scenario2") for key in keys(table(name))} <= rows.keys()
    assert all(row.meaning for row in rows.values())
    assert (rows["cycle_time"].unit, rows["cycle_time"].default) == ("s", "required")
    assert (rows["phase.kind"].default, rows["periodic"].default, rows["spring.catalogue"].default) == (
        "free",
        "true",
        "",
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, ": no such file; expected a scenario in TOML"),
        (b"name = ", " line 1: not valid TOML: "),
        (b"\xff\xfe", " line 1: byte 0xff is not UTF-8"),
        (b"[" * 5000, " line 1: not valid TOML at column 3: "),
    ],
)
def test_a_file_that_is_no_scenario(tmp_path: Path, text: bytes | None, message: str) -> None:
    path = tmp_path / "s.toml"
    if text is not None:
        path.write_bytes(text)
    with pytest.raises(ModelError) as told:
        scenario_file.read(path)
    assert str(told.value).startswith(f"{path}{message}")


def test_a_contact_phase_needs_four_joints_and_a_plate(two: Model) -> None:
    document = table("scenario2") | {"moving": [], "spring": [], "contact": {}, "ranges": {}}
    with pytest.raises(ModelError, match="phase 2: a contact phase needs a planar arm of four revolute joints"):
        parsed(two, document)


def test_a_position_beyond_a_limit_is_a_mistake(two: Model) -> None:
    with pytest.raises(ModelError, match=r"points.end: q2 is 1.2 m; joint 2 can go from -1 to 1 m"):
        there(two, 1.0, {"q1": 0.0}, {"q1": 0.5, "q2": 1.2})


def test_a_range_beyond_a_limit_is_a_mistake(two: Model) -> None:
    with pytest.raises(ModelError, match=r"ranges: q2 is \[100, 200\] m; joint 2 can go from -1 to 1 m"):
        there(two, 1.0, {"q1": 0.0}, {"q1": 0.5}, ranges={"q2": [100.0, 200.0]})


# --- trajectory files ---


@pytest.fixture(scope="module")
def motion(model: Model) -> Trajectory:
    """There and back, in contact in between."""
    q = np.array([[-1.0, -0.9, -0.8, -0.7], [-0.5, -0.5, -0.6, -0.6], [0.3, 0.2, 0.2, 0.3], [-1.0, -1.1, -1.2, -1.0]])
    w = model.contact_coordinates(np.array([q[:, -1]] * 4).T)
    spring = {"stiffness": 5900.0, "radius": 0.06, "offset": -1.2, "pretension": 3.0}
    plate = {"stiffness": 600.0, "pretension": 24.0, "friction": 2.0, "position": -0.54}
    phases = (Phase("q", 0.5, q), Phase("w", 0.25, w), Phase("q", 0.5, q[:, ::-1].copy()))
    return Trajectory(model.name, "try", phases, True, -1.0, False, {4: spring}, {"plate": plate})


def test_what_is_written_is_read(tmp_path: Path, model: Model, motion: Trajectory) -> None:
    path = tmp_path / "t.json"
    motion.write(path)
    back = trajectory.read(path, model)
    assert back.document() == motion.document()
    t = np.linspace(-1.0, 3.0, 400)
    for name in ("q", "qd", "qdd"):
        np.testing.assert_array_equal(getattr(back.at(model, t), name), getattr(motion.at(model, t), name))
    # No object of Python is in the file.
    assert json.loads(path.read_text()) == motion.document().to_json()


TRAJECTORY_ERRORS: dict[str, tuple[Change, str]] = {
    "format": (lambda d: d.update(format="2"), "not a trajectory; expected an object with"),
    "missing": (lambda d: d.pop("phases"), 'missing key "phases"; needed are format, arm, scenario, periodic, phases'),
    "arm": (lambda d: d.update(arm="emps"), 'is for the arm "emps", but the model file describes "vishard4"'),
    "none": (lambda d: d.update(phases=[]), "phases: expected at least one"),
    "flag": (lambda d: d.update(periodic=1), "periodic is 1; expected true or false"),
    "elbow": (lambda d: d.update(elbow=0.5), "elbow is 0.5; expected 1 or -1, the sign of sin q_2"),
    "coordinates": (
        lambda d: d["phases"][0].update(coordinates="x"),
        'phase 1: coordinates is the text "x"; expected "q" or "w"',
    ),
    "duration": (lambda d: d["phases"][0].update(duration=0), "phase 1: duration is 0; expected a number in s > 0"),
    "rows": (lambda d: d["phases"][0]["points"].pop(), "phase 1: points: expected 4 rows of equal length"),
    "ragged": (lambda d: d["phases"][0]["points"][0].pop(), "phase 1: points: expected 4 rows of equal length"),
    "one point": (
        lambda d: d["phases"][0].update(points=[[0.0]] * 4),
        "phase 1: points: found 1 in a row, expected 2 to 30",
    ),
    "infinite": (
        lambda d: d["phases"][0]["points"][0].__setitem__(0, float("inf")),
        "phase 1: points is inf; expected a number in rad or m that is finite",
    ),
    "text": (
        lambda d: d["phases"][0]["points"][0].__setitem__(0, "1"),
        'phase 1: points is the text "1"; expected a number in rad or m',
    ),
    "off the plate": (
        lambda d: d["phases"][1]["points"][0].__setitem__(1, 0.1),
        "phase 2: the first coordinate is that of the plate and must be constant",
    ),
    "jump": (
        lambda d: d["phases"][0]["points"][2].__setitem__(0, 0.8),
        "q3 jumps by 0.5 from phase 3 to phase 1; expected continuous positions",
    ),
    "spring's joint": (lambda d: d["springs"][0].update(joint=5), "spring 1: joint is 5; expected a joint, 1 to 4"),
    "spring's value": (
        lambda d: d["springs"][0].update(stiffness=-1.0),
        "spring 1: stiffness is -1; expected a number in N/m >= 0",
    ),
    "spring's key": (
        lambda d: d["springs"][0].update(force=1.0),
        'spring 1: unknown key "force"; the closest known one is "',
    ),
    "less of a spring": (lambda d: d["springs"][0].pop("stiffness"), 'spring 1: missing key "stiffness"'),
    "two springs": (
        lambda d: d["springs"].append(copy.deepcopy(d["springs"][0])),
        "spring 2: joint 4 has a spring already; expected at most one",
    ),
    "unknown key": (lambda d: d.update(elbw=1.0), 'unknown key "elbw"; did you mean "elbow"?'),
    "phase's key": (
        lambda d: d["phases"][1].update(duratoin=1.0),
        'phase 2: unknown key "duratoin"; did you mean "dur',
    ),
    "plate's key": (
        lambda d: d["contact"]["plate"].update(stifness=1.0),
        'contact: plate: unknown key "stifness"; did',
    ),
    "no table": (lambda d: d["contact"].update(plate=3), "contact: plate: found 3; expected a table of parameters"),
    "no contact": (lambda d: d["contact"].update(viscous={}), 'contact: "viscous" is not an effect of the contact'),
}


@pytest.mark.parametrize("what", TRAJECTORY_ERRORS)
def test_a_mistake_in_a_trajectory_is_named(tmp_path: Path, model: Model, motion: Trajectory, what: str) -> None:
    change, message = TRAJECTORY_ERRORS[what]
    document = motion.document().to_json()
    change(document)
    path = tmp_path / "t.json"
    path.write_text(json.dumps(document))
    with pytest.raises(TrajectoryError) as told:
        trajectory.read(path, model)
    assert str(told.value).startswith(f"{path}: {message}" if message else f"{path} line 1: byte 0xff is not UTF-8")
    assert "\n" not in str(told.value)


def test_a_file_that_is_no_trajectory(tmp_path: Path, model: Model) -> None:
    path = tmp_path / "t.json"
    with pytest.raises(TrajectoryError, match="no such file; tendon optimize SCENARIO --out"):
        trajectory.read(path, model)
    path.write_text("{")
    with pytest.raises(TrajectoryError, match="not valid JSON"):
        trajectory.read(path, model)


def test_beyond_its_end_a_single_motion_rests_and_a_periodic_one_goes_on(model: Model, motion: Trajectory) -> None:
    whole = motion.duration
    again, before = motion.at(model, [0.3 + whole]), motion.at(model, [0.3])
    np.testing.assert_allclose(again.q, before.q, atol=1e-12)
    once = Trajectory(model.name, "try", motion.phases[:1], False, -1.0, False, {}, {})
    after = once.at(model, [once.duration + 1.0])
    np.testing.assert_allclose(after.q[:, 0], motion.phases[0].points[:, -1], atol=1e-12)
    np.testing.assert_array_equal([after.qd, after.qdd], 0.0)

"""Plans and sweeps in the studio: what is shown is what the command line says, what is broken gives a line and leaves
nothing, and by clicks a plan is opened, executed beside itself, cancelled and found again."""

from __future__ import annotations

import asyncio
import csv
import json
import re
from collections.abc import AsyncIterator, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bench_arm import BENCH, SPRING, THERE_AND_BACK, trajectory
from hypothesis import given
from hypothesis import strategies as st

from runtime.cli import output
from runtime.cli.main import app
from runtime.plain_json import plain
from runtime.planning import results
from runtime.planning.optimize import optimize
from runtime.planning.options import PlanningSettings
from runtime.report.signals.signal_set import SignalSet
from runtime.studio.session import SessionError, StudioSession
from runtime.studio.studio import Studio
from runtime.sweep import reading
from runtime.sweep.table import TableError
from runtime.workspace import SCENARIOS
from symbolic.model_file.arm import Limits
from tests.runtime.planning_cases import arm, there
from tests.studio.browser import Watched, chromium, studio
from tests.studio.test_work import failed, wait

SCENARIO = (SCENARIOS / "scenario1.toml").read_text(encoding="utf-8")
SOON, WORK = 20_000, 120_000
"""ms, on a machine that is busy with other tests."""


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bench, a plan of it, and what `tendon execute` says of that."""
    folder = tmp_path_factory.mktemp("bench")
    (folder / "bench.toml").write_text(BENCH)
    trajectory(THERE_AND_BACK, springs={1: SPRING}).write(folder / "plan.json")
    asked = ["execute", str(folder / "bench.toml"), str(folder / "plan.json"), "--on", "simulation"]
    assert output.run(app, [*asked, "--json", str(folder / "executed.json")]) == 0
    return folder


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The table of a sweep of a scenario of the toolkit, one of whose points no motion can meet."""
    folder = tmp_path_factory.mktemp("swept")
    over = ["--over", "cycle_time=0.1,1.2,1.4", "--over", "case=A,B", "--workers", "1"]
    assert output.run(app, ["sweep", "scenario1", *over, "--table", str(folder / "sweep.csv")]) == 1
    return folder / "sweep.csv"


@pytest.fixture
def made(tmp_path: Path, files: Path) -> Iterator[Studio]:
    """A session with the bench."""
    found = Studio(StudioSession.create(tmp_path / "session"))
    found.give_model(files / "bench.toml")
    yield found
    found.close()


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as started:
        yield started


# --- what is shown ---


def test_a_trajectory_alone_is_told_as_its_plan_was(library):
    """Two routes to one number: what an optimization says of a plan, and what is said of the file that it wrote."""
    model = arm(library, "rp", Limits(position=(-2.0, 2.0), speed=4.0))
    plan = optimize(
        model, there(model, 1.0, {"q1": 0.0, "q2": 0.0}, {"q1": 1.0, "q2": 0.2}), PlanningSettings(starts=1)
    )
    whole, alone = plain(results.document(model, plan)), plain(results.stated(model, plan.trajectory))
    for key in ("scenario", "arm", "friction", "joints", "samples", "springs"):
        assert alone[key] == whole[key]
    assert alone["cycle_time"] == pytest.approx(whole["cycle_time"], rel=1e-12)
    durations = [[phase["duration"] for phase in one["phases"]] for one in (alone, whole)]
    assert durations[0] == pytest.approx(durations[1], rel=1e-12)


def test_a_plan_its_execution_and_both_again_after_the_server_has_ended(made, files):
    made.open_plans(files / "plan.json")
    wait(made)
    plan = made.plans.plan(1)
    assert plan["name"] == "plan.json"
    assert plan["springs"] == ["Spring at joint 1: 3000 N/m, taut below -0.5 rad."]
    assert len(plan["phases"]) == 2
    assert plan["table"]["rows"][0][3] == "25 N m"
    assert len(plan["arm"]["springs"]) == 1
    assert list((made.session.folder / "given").iterdir()) == [made.session.given(made.inputs.model)]
    signals = SignalSet.load(made.signals("plan1-joint1"))
    limits = [curve.y[0] for curve in signals.panels[0].curves if curve.name == "limit"]
    assert set(limits) <= {-1.8, 1.8}
    # From station to station by polynomials whose rates and accelerations vanish at both ends.
    assert signals.lines["position"].min() == pytest.approx(-1.2, abs=1e-3)
    s = np.linspace(0.0, 1.0, 5)
    expected = -1.2 * s**3 * (10 - 15 * s + 6 * s**2)
    assert np.interp(0.7 * s, signals.t, signals.lines["position"]) == pytest.approx(expected, abs=2e-3)

    made.plans.execute(1)
    wait(made)
    executed, said = made.plans.executed(1), json.loads((files / "executed.json").read_text())
    assert executed["kind"] == "clean"
    facts = {fact["name"]: fact["value"] for fact in executed["facts"]}
    assert facts["cycles"] == str(sum(len(trial["cycles"]) for trial in said["trials"]))
    assert float(facts["executed"].split()[0]) == pytest.approx(said["mean"]["total"], rel=1e-3)
    run = SignalSet.load(made.signals("plan1-executed1"))
    # By the definition of what is off the plan, and as large as the command line says.
    off = run.lines["position"] - run.lines["planned position"]
    assert run.lines["error"] == pytest.approx(off, abs=1e-12)
    assert np.abs(off).max() == pytest.approx(said["mean"]["tracking_max"][0], rel=0.05)
    assert run.units["error"] == "rad"
    assert run.unit == "N m"
    made.close()
    again = Studio(StudioSession.open(made.session.folder))
    try:
        assert again.plans.plan(1) == plan
        assert again.plans.executed(1) == executed
        assert again.plans.file(1, "trajectory.json").read_bytes() == (files / "plan.json").read_bytes()
        again.plans.take_away("plans", 1)
        assert again.plans.numbers("plans") == []
    finally:
        again.close()


def test_an_arm_of_the_toolkit_needs_no_model_and_a_foreign_one_does(made, tmp_path, files):
    foreign = json.loads((files / "plan.json").read_text()) | {"arm": "nobody's"}
    (tmp_path / "foreign.json").write_text(json.dumps(foreign))
    made.open_plans(tmp_path / "foreign.json")
    assert "give its model file first" in failed(made)
    (tmp_path / "own.toml").write_text(SCENARIO)
    made.open_plans(tmp_path / "own.toml")
    wait(made)
    plan = made.plans.plan(1)
    assert plan["headline"].startswith("scenario1 in 1.2 s")
    assert plan["phases"][0].startswith("home to turn, free")
    assert "own.toml" in made.plans.scenarios().values()


def test_an_execution_that_was_cancelled_leaves_nothing(made, files):
    made.open_plans(files / "plan.json")
    wait(made)
    made.plans.execute(1)
    made.cancel()
    assert made.work.state == "cancelled"
    assert made.plans.executed(1) is None
    assert not made.session.scratch.exists()
    made.plans.execute(1)
    with pytest.raises(SessionError, match="being worked on"):
        made.plans.take_away("plans", 1)
    made.cancel()


# --- sweeps ---


def test_a_point_of_a_sweep_is_planned_again_as_the_sweep_did(made, swept):
    made.open_plans(swept)
    wait(made)
    sweep = made.plans.sweep(1)
    assert sweep["axes"] == ["cycle_time", "case"]
    rows = list(csv.DictReader(swept.read_text().splitlines()))
    assert [p["cost"] for p in sweep["points"]] == [float(r["cost"]) if r["cost"] else None for r in rows]
    assert sweep["points"][0]["reason"] == rows[0]["message"] != ""
    with_plan = next(k for k, p in enumerate(sweep["points"]) if p["cost"] is not None and p["at"]["case"] == "B")
    made.plans.plan_point(1, with_plan, "scenario1")
    wait(made)
    found = made.plans.plan(1)["swept"]
    assert found["cost"] == pytest.approx(sweep["points"][with_plan]["cost"], rel=1e-6)
    assert made.plans.plans_of(1) == {with_plan: 1}
    made.plans.plan_point(1, 0, "scenario1")
    assert "has no plan" in failed(made)
    # A number is not given twice: the plan belongs to the sweep that is gone.
    made.plans.take_away("sweeps", 1)
    made.open_plans(swept)
    wait(made)
    assert made.plans.numbers("sweeps") == [2]
    assert made.plans.plans_of(2) == {}


def test_parquet_says_the_same(swept, tmp_path):
    pyarrow = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    rows = reading.read(swept, 100)
    columns = {name: [row[name] for row in csv.DictReader(swept.read_text().splitlines())] for name in ("message",)}
    table = {
        "cycle_time": [row.at["cycle_time"] for row in rows],
        "case": [row.at["case"] for row in rows],
        "seed": [row.seed for row in rows],
        "feasible": [row.feasible for row in rows],
        "cost": [row.cost for row in rows],
        **{name: [row.figures.get(name) for row in rows] for name in rows[-1].figures},
        **columns,
    }
    parquet.write_table(pyarrow.table(table), tmp_path / "sweep.parquet")
    assert reading.read(tmp_path / "sweep.parquet", 100) == rows
    with pytest.raises(TableError, match="more than 2 rows"):
        reading.read(tmp_path / "sweep.parquet", 2)
    (tmp_path / "broken.parquet").write_bytes(b"PAR1 nothing")
    with pytest.raises(TableError, match="no Parquet"):
        reading.read(tmp_path / "broken.parquet", 2)


CELLS = st.sampled_from(["", "1.2", "nan", "1e999", "A", "True", "False", "x" * 9, '"', "0", "-1", "\n", "seed"])


@given(st.lists(st.lists(CELLS, max_size=7), max_size=4), st.booleans())
def test_a_table_of_anything_is_read_or_refused(tmp_path_factory, lines, headed):
    path = tmp_path_factory.mktemp("any") / "table.csv"
    head = ["cycle_time,case,seed,feasible,cost,iterations,message"] if headed else []
    path.write_text("\n".join([*head, *(",".join(line) for line in lines)]))
    with suppress(TableError):
        for row in reading.read(path, 3):
            assert (row.cost is not None) == (row.feasible is True)


def test_the_best_of_the_seeds_stands_for_a_variation(tmp_path):
    path = tmp_path / "sweep.csv"
    head = "cycle_time,seed,feasible,cost,smooth_cost,message\n"
    path.write_text(head + "1.0,0,True,3.0,3.0,\n1.0,1,True,2.0,2.0,\n1.0,2,False,,,too slow\n2.0,0,,,,lost\n")
    first, second = reading.variations(reading.read(path, 10))
    assert (first.best.seed, first.jobs, first.costs) == (1, 3, (2.0, 3.0))
    assert (second.best.message, second.jobs, second.costs) == ("lost", 1, ())


# --- hostile files ---


async def chunks(content: bytes) -> AsyncIterator[bytes]:
    yield content


BROKEN = {
    "nonsense.json": (b"not JSON", "not valid JSON"),
    "deep.json": (b"[" * 200_000, "not valid JSON"),
    "other.json": (b'{"format": "other"}', "not a trajectory"),
    "nameless.json": (b'{"format": "tendon trajectory 1", "arm": 3}', "name of the arm"),
    "path.json": (b'{"format": "tendon trajectory 1", "arm": "../../etc/passwd"}', "give its model file first"),
    "endless.json": (
        b'{"format": "tendon trajectory 1", "arm": "bench", "scenario": "x", "periodic": false, "phases": '
        b'[{"coordinates": "q", "duration": 1, "points": [[0, 1e999]]}]}',
        "finite",
    ),
    "nonsense.toml": (b"= no scenario", "not valid TOML"),
    "outside.toml": (SCENARIO.replace('"vishard4"', '"../../x.toml"').encode(), "give its model file first"),
    "nonsense.csv": (b"a,b\n1,2\n", "no table of a sweep"),
    "binary.csv": (b"\xff\xfe\x00", "no CSV"),
}


def test_what_is_broken_gives_a_line_and_leaves_nothing(made):
    before = sorted(p.relative_to(made.session.folder) for p in made.session.folder.rglob("*"))
    for name, (content, said) in BROKEN.items():
        asyncio.run(made.send_plan(name, chunks(content)))
        assert said in failed(made), name
    after = sorted(p.relative_to(made.session.folder) for p in made.session.folder.rglob("*"))
    assert after == before
    for name, content, said in (("plan.exe", b"", "expected a trajectory"), ("big.toml", b"x" * 10_000_001, "larger")):
        with pytest.raises(SessionError, match=said):
            asyncio.run(made.send_plan(name, chunks(content)))
    assert sorted(p.relative_to(made.session.folder) for p in made.session.folder.rglob("*")) == before


def test_the_verb_refuses_what_it_could_not_open_before_a_folder_is_made(tmp_path, monkeypatch, capsys, files):
    monkeypatch.chdir(tmp_path)
    for arguments in (
        [str(files / "bench.toml"), "--plan", str(files / "bench.toml"), "--demo"],
        [str(files / "bench.toml"), str(files / "plan.json"), "--plan", str(files / "plan.json")],
    ):
        assert output.run(app, ["studio", *arguments]) == 2
        assert "--plan opens plans of MODEL without recordings" in capsys.readouterr().err
    (tmp_path / "plan.txt").write_text("")
    assert output.run(app, ["studio", "--plan", "plan.txt"]) == 2
    assert "expected a trajectory" in capsys.readouterr().err
    assert [p.name for p in tmp_path.iterdir()] == ["plan.txt"]


# --- by clicks ---


def test_a_plan_opened_executed_cancelled_and_found_again_by_clicks(browser, files, tmp_path):
    """Costs and limits are there, the execution stands beside the plan, and both are there after the server's end."""
    hostile = tmp_path / "<img src=x onerror=alert(1)>.json"
    document = json.loads((files / "plan.json").read_text()) | {"scenario": "<b>there</b>"}
    hostile.write_text(json.dumps(document))
    with studio(tmp_path, files / "bench.toml") as address:
        seen = Watched(browser, address)
        page = seen.page
        page.set_input_files("#plans file-drop input", hostile, timeout=SOON)
        page.wait_for_selector("#plan-joint tendon-signals[data-ready]", timeout=WORK)
        text = page.inner_text("#plan")
        assert "<img src=x onerror=alert(1)>.json" in text
        assert "<b>there</b> in 1.4 s, with friction" in text
        assert "25 N m" in text  # the torque's limit
        assert page.locator("#plan img, #plan b").count() == 0
        page.click("[data-do=execute]")
        page.click("[data-do=cancel]", timeout=SOON)
        page.wait_for_selector("[role=alert]:has-text('Cancelled')", timeout=SOON)
        page.click("[data-do=execute]:not([disabled])", timeout=SOON)
        page.wait_for_selector("[data-executed] .tag:has-text('done')", timeout=WORK)
        page.wait_for_selector("#plan-joint tendon-signals[data-ready] >> nth=1", timeout=SOON)
        planned, executed = costs(page)
        assert executed == pytest.approx(planned, rel=0.1)
        with page.expect_download() as begun:
            page.click("a.download:has-text('trajectory')")
        assert json.loads(Path(begun.value.path()).read_text()) == document
        assert seen.wrong == []
        assert seen.outside() == []
    with studio(tmp_path, tmp_path / "studio-session") as address:
        seen = Watched(browser, address, 390, "dark")
        seen.page.wait_for_selector("[data-executed] .tag:has-text('done')", timeout=SOON)
        assert costs(seen.page) == (planned, executed)
        assert seen.page.evaluate("document.documentElement.scrollWidth") == 390
        seen.page.click("[data-do=plan-away]")
        seen.page.wait_for_selector("#plan", state="hidden", timeout=SOON)
        assert seen.wrong == []


def costs(page: Any) -> tuple[float, float]:
    """Planned and executed, beside each other."""
    said = page.inner_text("[data-executed] .facts")
    found = [float(re.search(rf"{name}\s+([\d.]+)", said)[1]) for name in ("cost planned", "executed")]
    return found[0], found[1]


def test_a_point_of_a_sweep_pressed_in_the_figure_is_planned_and_shown(browser, swept, tmp_path):
    with studio(tmp_path, "--plan", swept) as address:
        seen = Watched(browser, address)
        page = seen.page
        page.wait_for_selector("#sweep svg", timeout=WORK)
        page.click("[data-do=point-0]")
        page.wait_for_selector("#sweep-point:has-text('There is no plan')", timeout=SOON)
        page.locator("[data-do=dot-2]").press("Enter")
        page.select_option("#sweep-point select", "scenario1", timeout=SOON)
        page.click("[data-do=point]:not([disabled])")
        page.wait_for_selector("#plan:has-text('It costs what the sweep found')", timeout=WORK)
        page.wait_for_selector("[data-do=point-2]:has-text('Open')", timeout=SOON)
        page.click("[data-do=point-plan]")
        assert seen.wrong == []
        assert seen.outside() == []

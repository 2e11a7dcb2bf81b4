"""Sweeps: a grid of optimizations whose table does not depend on where they ran or what died on the way."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow.parquet as parquet
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime.cli import output
from runtime.cli.main import app
from runtime.model.loader import Model
from runtime.planning import scenario_file
from runtime.planning.scenario import Scenario
from runtime.sweep import grid, journal
from runtime.sweep.job import Code, Job, JobResult, Pool, PoolError, outcomes, processes
from runtime.workspace.source import Source
from symbolic.effects import LIBRARY
from tests import one_joint

ROOT = Path(__file__).resolve().parents[3]
ARM = one_joint.model_text(
    """\
[joint.limits]
torque = 60.0
speed = 12.0
[joint.effects.coulomb]
torque = 1.5
[joint.effects.viscous]
coefficient = 0.8
""",
    name="swing1",
)
SCENARIO = """\
name = "swing"
model = "arm.toml"
cycle_time = 1.2

[points.home]
q1 = 0.0
rest = true
[points.turn]
q1 = -1.5
rest = true

[[phase]]
from = "home"
to = "turn"
part = 0.5
degree = 6
monotone = true
[[phase]]
from = "turn"
to = "home"
part = 0.5
degree = 6
monotone = true

[[spring]]
joint = 1
stiffness = [1000.0, 9000.0]
offset = [-2.0, 0.5]
radius = 0.06
catalogue = [2000.0, 4000.0, 6000.0]
"""
GRID = ("--over", "cycle_time=1.0,1.4", "--over", "case=A,D", "--over", "seed=0:2")
JOBS = 12
ONE = ("--workers", "1")


def table(path: Path) -> pd.DataFrame:
    """All but the one column that is a measurement."""
    read = pd.read_parquet if path.suffix == ".parquet" else partial(pd.read_csv, keep_default_na=True)
    return read(path).drop(columns="seconds")


def lines(path: Path) -> list[dict[str, Any]]:
    """The whole lines of a journal after its heading."""
    whole = path.read_bytes().split(b"\n")[1:-1] if path.exists() else []
    return [json.loads(line) for line in whole]


def once(diary: Path, jobs: int = JOBS) -> bool:
    """Every job is there, and none twice."""
    keys = [line["key"] for line in lines(diary)]
    return len(keys) == len(set(keys)) == jobs


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("sweep")
    (path / "arm.toml").write_text(ARM)
    (path / "swing.toml").write_text(SCENARIO)
    return path


@dataclass(frozen=True)
class Run:
    """`tendon sweep swing.toml` in this process."""

    folder: Path

    def __call__(self, name: str, *arguments: str) -> tuple[int, dict[str, Any]]:
        """Exit status and the JSON document."""
        document = self.folder / f"{name}.json"
        document.unlink(missing_ok=True)
        target = ["--table", str(self.folder / name), "--json", str(document)]
        status = output.run(app, ["sweep", str(self.folder / "swing.toml"), *target, *arguments])
        return status, json.loads(document.read_text()) if document.exists() else {}


@pytest.fixture(scope="module")
def run(folder: Path) -> Run:
    return Run(folder)


@pytest.fixture(scope="module")
def undisturbed(run: Run, folder: Path) -> pd.DataFrame:
    """The table of GRID when nothing happens."""
    status, document = run("undisturbed.csv", *GRID)
    assert status == 0
    assert (document["jobs"], document["found_finished"]) == (JOBS, 0)
    assert once(folder / "undisturbed.csv.journal")
    return table(folder / "undisturbed.csv")


@pytest.fixture(scope="module")
def swing(folder: Path) -> tuple[Scenario, Model, Code]:
    model = Source.read(folder / "arm.toml", None).compiled.model()
    scenario = scenario_file.fitted(scenario_file.read(folder / "swing.toml"), model, "swing.toml")
    return scenario, model, Code(model.directory, model.library.directory)


def jobs_of(swing: tuple[Scenario, Model, Code], *over: str) -> list[Job]:
    scenario, model, code = swing
    return grid.jobs(scenario, grid.parse(over, LIBRARY), model, code, None)


# --- the grid ---


@pytest.mark.parametrize(
    ("over", "message"),
    [
        (["cycle_time"], "expected NAME=VALUES"),
        (["=1"], "expected NAME=VALUES"),
        (["cycle_tim=1"], 'did you mean "cycle_time"?'),
        (["cycle_time=1.0:2.0"], "expected START:END:STEP"),
        (["cycle_time=2:1:0.1"], "empty range"),
        (["cycle_time=1:2:0"], "empty range"),
        (["cycle_time=one"], "no number and no range"),
        (["cycle_time=nan"], "no number and no range"),
        (["cycle_time=1,,2"], "no number and no range"),
        (["cycle_time=0"], "expected 0.01 to 3600 s"),
        (["cycle_time=1:1e9:0.001"], "expected at most"),
        (["cycle_time=1:2:1e-320"], "expected at most 1000000"),
        (["case=A,E"], 'no case "E"'),
        (["seed=1.5"], "whole numbers"),
        (["seed=-1"], "whole numbers"),
        (["stiffness=-5"], "0 or more"),
        (["case=A", "case=B"], "given twice"),
        (["stiffness=5000", "stiffness@1=5000"], "give a joint to each, or to none"),
        (["__import__('os')=1"], "nothing is called"),
    ],
)
def test_what_cannot_be_meant_is_refused(over: list[str], message: str) -> None:
    with pytest.raises(grid.GridError) as error:
        grid.parse(over, LIBRARY)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


@settings(deadline=None)
@given(st.integers(1, 50), st.integers(0, 40), st.sampled_from([1, 2, 5, 10, 25]))
def test_a_range_has_both_ends_and_says_what_a_person_would(start: int, count: int, step: int) -> None:
    """In hundredths: no 1.2000000000000002, and no end lost to rounding."""
    text = f"cycle_time={start / 100}:{(start + count * step) / 100}:{step / 100}"
    (axis,) = grid.parse([text], LIBRARY)
    assert axis.values == tuple((start + k * step) / 100 for k in range(count + 1))


def test_seeds_count_in_ones() -> None:
    assert grid.parse(["seed=0:3,7"], LIBRARY)[0].values == (0, 1, 2, 3, 7)


def test_the_cases_are_those_of_the_paper(swing: Any) -> None:
    jobs = jobs_of(swing, "case=A,B,C,D")
    found = {j.columns["case"]: (j.scenario.friction, bool(j.scenario.springs)) for j in jobs}
    assert found == {"A": (False, False), "B": (False, True), "C": (True, False), "D": (True, True)}


def test_a_case_without_springs_is_not_repeated_for_each_of_them(swing: Any) -> None:
    jobs = jobs_of(swing, "stiffness=3000,5000", "offset@1=0", "case=A,B")
    assert [tuple(j.columns.values()) for j in jobs] == [(None, None, "A"), (3000.0, 0.0, "B"), (5000.0, 0.0, "B")]
    assert jobs[1].scenario.springs[0].sought["stiffness"] == (3000.0, 3000.0)
    assert jobs[1].scenario.springs[0].sought["offset"] == (0.0, 0.0)
    assert jobs[1].scenario.springs[0].catalogue == ()


def test_a_key_says_what_decides_the_result(swing: Any) -> None:
    scenario, model, code = swing
    axes = grid.parse(["seed=0,1"], LIBRARY)
    first, second = grid.jobs(scenario, axes, model, code, None)
    assert first.key == grid.jobs(scenario, axes, model, code, None)[0].key
    others = [
        second,
        grid.jobs(scenario, axes, model, code, 2)[0],
        grid.jobs(replace(scenario, friction=False), axes, model, code, None)[0],
        grid.jobs(scenario, axes, model, Code(code.library, code.library), None)[0],
    ]
    assert len({job.key for job in (first, *others)}) == 5


@pytest.mark.parametrize(
    ("over", "message"),
    [("stiffness@2=5000", "it has springs at joint 1"), ("plate.stiffness=600", "has no such effect at its contact")],
)
def test_what_the_scenario_has_not_cannot_vary(run: Run, folder: Path, capfd: Any, over: str, message: str) -> None:
    before = sorted(folder.iterdir())
    status, _ = run("refused.csv", "--over", over)
    err = capfd.readouterr().err
    assert (status, sorted(folder.iterdir())) == (2, before)
    assert message in err
    assert err.count("\n") == 1


def test_a_contact_varies_by_its_parameters() -> None:
    model = Source.read(ROOT / "symbolic" / "arms" / "vishard4.toml", None).compiled.model()
    path = ROOT / "runtime" / "study" / "scenario2.toml"
    scenario = scenario_file.fitted(scenario_file.read(path), model, str(path))
    axes = grid.parse(["plate.stiffness=600,1300"], LIBRARY)
    jobs = grid.jobs(scenario, axes, model, Code(model.directory, model.library.directory), None)
    assert [job.scenario.contact["plate"]["stiffness"] for job in jobs] == [600.0, 1300.0]


# --- the table ---


@pytest.mark.xdist_group("undisturbed sweep")
def test_one_row_a_job_in_the_order_of_the_grid(undisturbed: pd.DataFrame) -> None:
    rows = list(undisturbed[["cycle_time", "case", "seed"]].itertuples(index=False, name=None))
    assert rows == [(T, case, seed) for T in (1.0, 1.4) for case in "AD" for seed in range(3)]
    assert undisturbed["feasible"].all()
    assert (undisturbed["cost"] == undisturbed["cost_joint1"]).all()
    with_spring = undisturbed["case"] == "D"
    assert undisturbed["stiffness_joint1"].isin([2000.0, 4000.0, 6000.0]).equals(with_spring)
    best = undisturbed.groupby(["cycle_time", "case"])["cost"].min()
    assert best[1.4, "A"] == pytest.approx(best[1.0, "A"] * (1.0 / 1.4) ** 3, rel=1e-9)


@pytest.mark.xdist_group("undisturbed sweep")
def test_the_document_says_what_the_table_says(run: Run, undisturbed: pd.DataFrame) -> None:
    status, document = run("undisturbed.csv", *GRID)
    assert (status, document["found_finished"]) == (0, JOBS)
    for variation in document["variations"]:
        at = variation["at"]
        rows = undisturbed[(undisturbed["cycle_time"] == at["cycle_time"]) & (undisturbed["case"] == at["case"])]
        assert variation["best"] == rows["cost"].min()
        assert variation["worst"] == rows["cost"].max()
        assert variation["close"] == (rows["cost"] <= 1.01 * rows["cost"].min()).mean()


@pytest.mark.xdist_group("undisturbed sweep")
def test_parquet_and_csv_are_equal(run: Run, folder: Path, undisturbed: pd.DataFrame) -> None:
    # The journal alone decides what is in a table, so that of the CSV serves.
    (folder / "same.parquet.journal").write_bytes((folder / "undisturbed.csv.journal").read_bytes())
    assert run("same.parquet", *GRID)[0] == 0
    found = table(folder / "same.parquet")
    assert list(found.columns) == list(undisturbed.columns)
    assert parquet.read_schema(folder / "same.parquet").field("feasible").type == "bool"
    for name in found.columns:
        ours, theirs = found[name], undisturbed[name]
        # CSV has one way to write nothing.
        blank = [(a == "" or pd.isna(a)) and pd.isna(b) for a, b in zip(ours, theirs, strict=True)]
        assert all(none or a == b for none, a, b in zip(blank, ours, theirs, strict=True)), name


def test_values_may_be_added_and_what_is_infeasible_is_a_row(run: Run, folder: Path) -> None:
    assert run("grows.csv", "--over", "cycle_time=1.2", "--over", "case=A", *ONE)[0] == 0
    status, document = run("grows.csv", "--over", "cycle_time=0.1,1.2", "--over", "case=A", *ONE)
    assert (status, document["jobs"], document["found_finished"]) == (1, 2, 1)
    short, long = table(folder / "grows.csv").to_dict("records")
    assert (short["feasible"], long["feasible"]) == (False, True)
    assert "joint 1 is missed by" in short["message"]
    assert pd.isna(short["cost"])
    assert [v["infeasible"] for v in document["variations"]] == [1, 0]
    assert document["variations"][0]["reason"] == short["message"]


def test_a_name_that_is_no_table_is_refused(run: Run, capfd: Any) -> None:
    assert run("table.xlsx", *GRID)[0] == 2
    assert "ends in .csv or .parquet" in capfd.readouterr().err


# --- what a journal holds ---


@pytest.mark.xdist_group("undisturbed sweep")
def test_a_journal_goes_on_where_it_was_torn(run: Run, folder: Path, undisturbed: pd.DataFrame) -> None:
    whole = (folder / "undisturbed.csv.journal").read_bytes()
    ends = [i + 1 for i, byte in enumerate(whole) if byte == ord("\n")]
    torn = folder / "torn.csv.journal"
    torn.write_bytes(whole[: ends[-3] + 40])
    status, document = run("torn.csv", *GRID, *ONE)
    assert (status, document["found_finished"]) == (0, JOBS - 2)
    assert once(torn)
    pd.testing.assert_frame_equal(table(folder / "torn.csv"), undisturbed, check_exact=True)


@pytest.mark.xdist_group("undisturbed sweep")
@pytest.mark.usefixtures("undisturbed")
def test_the_journal_of_another_sweep_is_refused(run: Run, folder: Path, capfd: Any) -> None:
    diary = folder / "other.csv.journal"
    diary.write_bytes((folder / "undisturbed.csv.journal").read_bytes())
    before = diary.read_bytes()
    for change, message in (
        (["--over", "case=A"], "varies something else"),
        ([*GRID, "--starts", "3"], "another number of --starts"),
    ):
        assert run("other.csv", *change)[0] == 2
        assert message in capfd.readouterr().err
    for name, old, new, message in (
        ("swing.toml", "part = 0.5\ndegree = 6", "part = 0.5\ndegree = 7", "of another scenario"),
        ("arm.toml", "mass = 2.0", "mass = 2.1", "of another arm"),
    ):
        text = (folder / name).read_text()
        (folder / name).write_text(text.replace(old, new))
        assert run("other.csv", *GRID)[0] == 2
        (folder / name).write_text(text)
        assert message in capfd.readouterr().err
    lines_of = before.splitlines(keepends=True)
    diary.write_bytes(b"".join([*lines_of[:3], b"{garbage\n", *lines_of[4:]]))
    assert run("other.csv", *GRID)[0] == 2
    assert "other.csv.journal line 4" in capfd.readouterr().err
    assert not (folder / "other.csv").exists()


def test_a_table_without_its_journal_is_not_overwritten(run: Run, folder: Path, capfd: Any) -> None:
    (folder / "mine.csv").write_text("hours of work\n")
    assert run("mine.csv", *GRID)[0] == 2
    assert "exists without its journal" in capfd.readouterr().err
    assert (folder / "mine.csv").read_text() == "hours of work\n"


# --- what dies on the way ---


def when(condition: Callable[[], bool], act: Callable[[], None]) -> threading.Thread:
    """A thread that acts once, as soon as a condition holds."""

    def watch() -> None:
        end = time.monotonic() + 300.0
        while not condition():
            if time.monotonic() > end:
                return
            time.sleep(0.002)
        act()

    thread = threading.Thread(target=watch)
    thread.start()
    return thread


def kill(pid: int) -> None:
    os.kill(pid, signal.SIGKILL)


@pytest.mark.xdist_group("undisturbed sweep")
def test_killed_in_the_middle_it_goes_on_to_the_same_table(folder: Path, run: Run, undisturbed: pd.DataFrame) -> None:
    diary = folder / "killed.csv.journal"
    script = "import sys; from runtime.cli.main import main; main()"
    command = [sys.executable, "-c", script, "sweep", "swing.toml", "--table", "killed.csv", *GRID, *ONE]
    path = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
    parent = subprocess.Popen(command, cwd=folder, env={**os.environ, "PYTHONPATH": path}, stderr=subprocess.DEVNULL)
    when(lambda: len(lines(diary)) >= 3, lambda: kill(parent.pid)).join()
    assert parent.wait() == -signal.SIGKILL
    finished = len(lines(diary))
    assert 3 <= finished < JOBS
    assert not (folder / "killed.csv").exists()
    status, document = run("killed.csv", *GRID, *ONE)
    assert (status, document["found_finished"]) == (0, finished)
    assert once(diary)
    pd.testing.assert_frame_equal(table(folder / "killed.csv"), undisturbed, check_exact=True)


class DeadlyJob(Job):
    """Its worker process dies as soon as it receives it."""

    def __reduce__(self) -> tuple[Any, ...]:
        return os.abort, ()


def test_a_job_that_kills_its_worker_fails_alone(swing: Any) -> None:
    jobs = jobs_of(swing, "seed=0:3")
    jobs[1] = DeadlyJob(**vars(jobs[1]))
    with processes(swing[2], 2) as pool:
        found = {job.seed: result for job, result in outcomes(pool, jobs)}
    assert {seed: result.feasible for seed, result in found.items()} == {0: True, 1: None, 2: True, 3: True}
    assert found[1].message == "its worker process died 2 times"


@contextmanager
def in_threads(task: Callable[[Job], JobResult]) -> Iterator[Pool]:
    with ThreadPoolExecutor(2) as executor:
        yield Pool(executor, task, lost="")


def test_a_machine_that_kills_every_worker_is_reported(swing: Any) -> None:
    def die(_: Job) -> JobResult:
        raise BrokenProcessPool

    with in_threads(die) as pool, pytest.raises(PoolError, match="is there enough memory"):
        list(outcomes(pool, jobs_of(swing, "seed=0:11")))


def test_a_failed_job_is_tried_again(swing: Any, tmp_path: Path) -> None:
    """It is a row of the table, and not in the journal."""
    scenario, model, code = swing
    jobs = jobs_of(swing, "seed=0:3")
    names = journal.columns(scenario, model.n, ["seed"])
    ended: list[None] = []
    for bad, new in ((1, 4), (None, 1)):

        def task(job: Job, bad: int | None = bad) -> JobResult:
            if job.seed == bad:
                raise MemoryError
            return JobResult(feasible=True, cost=float(job.seed))

        ended.clear()
        heading = journal.heading(scenario, code, None, ["seed"])
        with in_threads(task) as pool, journal.opened(tmp_path / "t.csv.journal", heading) as kept:
            results = journal.run(jobs, pool, kept, lambda: ended.append(None))
        assert len(ended) == new
        journal.write(tmp_path / "t.csv", names, jobs, results)
        feasible = pd.read_csv(tmp_path / "t.csv")["feasible"]
        assert list(feasible.isna()) == [seed == bad for seed in range(4)]


def test_two_sweeps_do_not_share_a_journal(swing: Any, tmp_path: Path) -> None:
    scenario, _, code = swing
    heading = journal.heading(scenario, code, None, ["seed"])
    with (
        journal.opened(tmp_path / "t.csv.journal", heading),
        pytest.raises(journal.JournalError, match="another sweep is writing to it"),
        journal.opened(tmp_path / "t.csv.journal", heading),
    ):
        pass


# --- a cluster ---


@pytest.fixture(scope="module")
def cluster(cache: Path) -> Iterator[Any]:  # noqa: ARG001
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(n_workers=2, processes=True, threads_per_worker=2, dashboard_address=None) as made,
        distributed.Client(made, set_as_default=False) as client,
    ):
        client.wait_for_workers(2, timeout=300)
        yield client


@pytest.mark.xdist_group("undisturbed sweep")
@pytest.mark.slow
def test_a_worker_killed_in_a_cluster_loses_and_doubles_nothing(
    run: Run, folder: Path, cluster: Any, undisturbed: pd.DataFrame
) -> None:
    diary = folder / "cluster.csv.journal"
    first, second = cluster.run(os.getpid).values()
    thread = when(lambda: len(lines(diary)) >= 3, lambda: kill(first))
    status, document = run("cluster.csv", *GRID, "--scheduler", cluster.scheduler.address)
    thread.join()
    assert (status, document["found_finished"]) == (0, 0)
    assert once(diary)
    pd.testing.assert_frame_equal(table(folder / "cluster.csv"), undisturbed, check_exact=True)
    cluster.wait_for_workers(2, timeout=300)
    after = set(cluster.run(os.getpid).values())
    assert second in after
    assert first not in after


def test_no_scheduler_is_one_line(run: Run, folder: Path, capfd: Any) -> None:
    status, _ = run("nowhere.csv", *GRID, "--scheduler", "carrier-pigeon://loft")
    err = capfd.readouterr().err
    assert status == 2
    assert "no Dask scheduler answers there" in err
    assert err.count("\n") == 1
    assert not (folder / "nowhere.csv.journal").exists()


@pytest.mark.parametrize(
    ("missing", "arguments", "remedy"),
    [
        ("distributed", ("x.csv", "--scheduler", "tcp://127.0.0.1:1"), "pip install 'dask[distributed]'"),
        ("pyarrow", ("x.parquet",), "pip install pyarrow"),
    ],
)
def test_a_missing_extra_says_how_to_get_it(
    run: Run, monkeypatch: Any, capfd: Any, missing: str, arguments: tuple[str, ...], remedy: str
) -> None:
    monkeypatch.setitem(sys.modules, missing, None)
    monkeypatch.delitem(sys.modules, "runtime.sweep.cluster", raising=False)
    name, *options = arguments
    assert run(name, *GRID, *options)[0] == 2
    err = capfd.readouterr().err
    assert remedy in err
    assert err.count("\n") == 1


def opened_journal(path: Path) -> None:
    with journal.opened(path, {"format": journal.FORMAT, "scenario": "s", "arm": "a", "starts": None, "over": []}):
        pass


@pytest.mark.parametrize(
    "content",
    [
        b"a journal of another tool",
        b"a journal of another tool\nwith lines\n",
        b'{"format": "of another tool"',
        b"[" * 10_000,
        b'{"format": ' + b"9" * 10_000 + b"}\n",
        b"\0" * 100,
    ],
)
def test_a_file_of_another_tool_stays_as_it_is(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "t.csv.journal"
    path.write_bytes(content)
    with pytest.raises(journal.JournalError, match=r"line 1|another version"):
        opened_journal(path)
    assert path.read_bytes() == content


def test_a_heading_that_was_cut_off_is_written_anew(tmp_path: Path) -> None:
    path = tmp_path / "t.csv.journal"
    opened_journal(path)
    whole = path.read_bytes()
    for length in (0, 1, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:length])
        opened_journal(path)
        assert path.read_bytes() == whole


@pytest.mark.parametrize(
    "result",
    [
        {},
        {"feasible": "yes", "message": ""},
        {"feasible": True, "message": ""},
        {"feasible": False, "message": 3},
        {"feasible": None, "message": "", "seconds": "long"},
        {"feasible": True, "message": "", "cost": [1], "smooth_cost": 1.0},
        {"feasible": True, "message": "", "cost": float("nan"), "smooth_cost": 1.0},
        {"feasible": 1, "message": "", "cost": True, "smooth_cost": 1.0},
    ],
)
def test_a_result_of_wrong_types_is_named(tmp_path: Path, result: dict[str, object]) -> None:
    path = tmp_path / "t.csv.journal"
    opened_journal(path)
    with path.open("a") as file:
        file.write(json.dumps({"key": "k", "at": {}, "result": result}) + "\n")
    before = path.read_bytes()
    with pytest.raises(journal.JournalError, match=r"line 2: not a line that a sweep writes; delete the line"):
        opened_journal(path)
    assert path.read_bytes() == before

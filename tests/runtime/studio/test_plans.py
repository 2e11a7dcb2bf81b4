"""Plans in the studio: a trajectory is opened and shown by the report's page; what is broken gives a line and leaves
nothing."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from bench_arm import BENCH, SPRING, THERE_AND_BACK, trajectory

from runtime.plain_json import plain
from runtime.planning import results
from runtime.planning.optimize import optimize
from runtime.planning.settings import PlanningSettings
from runtime.studio.session import SessionError, StudioSession
from runtime.studio.studio import Studio
from symbolic.model_file.arm import Limits
from tests.runtime.planning.planning_cases import arm, there
from tests.runtime.studio.waiting import chunks, done, failed


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bench, and a plan of it."""
    folder = tmp_path_factory.mktemp("bench")
    (folder / "bench.toml").write_text(BENCH)
    trajectory(THERE_AND_BACK, springs={1: SPRING}).write(folder / "plan.json")
    return folder


@pytest.fixture
def made(tmp_path: Path, files: Path) -> Iterator[Studio]:
    """A session with the bench."""
    found = Studio(StudioSession.create(tmp_path / "session"))
    found.give_model(files / "bench.toml")
    yield found
    found.close()


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


def test_a_plan_is_opened_found_again_and_closed(made, files):
    made.open_plans(files / "plan.json", files / "plan.json")
    done(made)
    assert [plan.name for plan in made.plans().values()] == ["plan.json"] * 2
    assert made.plans()[1].headline.startswith("there and back in 1.4 s, with friction")
    page = (made.session.plan(1) / "page.html").read_text()
    assert "Spring at joint 1: 3000 N/m, taut below -0.5 rad." in page
    assert "25 N m" in page  # the torque's limit
    assert list((made.session.folder / "given").iterdir()) == [made.session.given(made.inputs.model)]
    made.close()
    again = Studio(StudioSession.open(made.session.folder))
    try:
        again.close_plan(1)
        assert list(again.plans()) == [2]
        assert not again.session.plan(1).exists()
    finally:
        again.close()


def test_an_arm_of_the_toolkit_needs_no_model_and_a_foreign_one_does(made, tendon, tmp_path, files):
    foreign = json.loads((files / "plan.json").read_text()) | {"arm": "nobody's"}
    (tmp_path / "foreign.json").write_text(json.dumps(foreign))
    made.open_plans(tmp_path / "foreign.json")
    assert "give its model file first" in failed(made)
    assert tendon("optimize", "scenario1", "--starts", "1", "--out", tmp_path / "own.json")[0] == 0
    made.open_plans(tmp_path / "own.json")
    done(made)
    assert made.plans()[1].headline.startswith("scenario1 in 1.2 s")


def test_files_that_arrive_together_or_during_a_task_are_taken_in_their_order(tmp_path, files):
    """A plan is of the model that was sent before it, though that one needs longer to arrive; none is refused."""
    studio = Studio(StudioSession.create(tmp_path / "session"))
    model, plan = (files / "bench.toml").read_bytes(), (files / "plan.json").read_bytes()

    async def send() -> None:
        await asyncio.gather(
            studio.receive("model", "bench.toml", chunks(*(model[k : k + 9] for k in range(0, len(model), 9)))),
            studio.receive("plan", "first.json", chunks(plan)),
            studio.receive("plan", "second.json", chunks(plan)),
        )

    try:
        asyncio.run(send())
        done(studio)
        assert [plan.name for plan in studio.plans().values()] == ["first.json", "second.json"]
    finally:
        studio.close()


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
}


def test_what_is_broken_gives_a_line_and_leaves_nothing(made):
    before = sorted(p.relative_to(made.session.folder) for p in made.session.folder.rglob("*"))
    for name, (content, said) in BROKEN.items():
        asyncio.run(made.receive("plan", name, chunks(content)))
        assert said in failed(made), name
    after = sorted(p.relative_to(made.session.folder) for p in made.session.folder.rglob("*"))
    assert after == before
    for name, content, said in (("plan.toml", b"", "expected a trajectory"), ("big.json", b"x" * 10_000_001, "larger")):
        with pytest.raises(SessionError, match=said):
            asyncio.run(made.receive("plan", name, chunks(content)))
    assert sorted(p.relative_to(made.session.folder) for p in made.session.folder.rglob("*")) == before


def test_the_verb_refuses_what_it_could_not_open_before_a_folder_is_made(tmp_path, refused, files):
    for arguments in (
        (files / "bench.toml", "--plan", files / "bench.toml", "--demo"),
        (files / "bench.toml", files / "plan.json", "--plan", files / "plan.json"),
    ):
        assert "--plan opens plans of MODEL without recordings" in refused("studio", *arguments)
    (tmp_path / "plan.txt").write_text("")
    assert "expected a trajectory" in refused("studio", "--plan", "plan.txt")
    assert [p.name for p in tmp_path.iterdir()] == ["plan.txt"]

"""Hardware in the loop without hardware: the emulated firmware drives the simulated arm through the paper's scenarios,
and leaves the recording that this computer's build of it leaves, bit for bit."""

from __future__ import annotations

import functools
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from runtime.cli import output
from runtime.cli.main import app
from runtime.execution.execute import SIMULATED, Execution, execute
from runtime.execution.options import ExecutionSettings
from runtime.model.loader import Model
from runtime.planning.optimize import optimize
from runtime.planning.settings import PlanningSettings
from runtime.planning.trajectory import Trajectory
from runtime.study.study import HIDDEN, StudyCase
from runtime.workspace.source import Source

pytestmark = pytest.mark.xdist_group("hil")
EMULATED = [
    pytest.param("unicorn"),
    pytest.param(
        "qemu",
        marks=[
            pytest.mark.skipif(shutil.which("qemu-system-arm") is None, reason="needs qemu-system-arm"),
            pytest.mark.slow,
        ],
    ),
]
CASES = {"scenario1": StudyCase("D", 1.2), "scenario2": StudyCase("B", 1.2, 600.0)}
"""With springs; friction planned with and compensated in the first, the plate pressed in the second."""


@pytest.fixture(scope="module")
def source(cache: Path) -> Source:  # noqa: ARG001 - the cache is where it is compiled
    return Source.shipped("vishard4")


@pytest.fixture(scope="module")
def arm(source: Source) -> Model:
    return source.compiled.model()


@pytest.fixture(scope="module")
def plans(arm: Model) -> dict[str, Trajectory]:
    return {
        name: optimize(arm, case.scenario(arm), PlanningSettings(starts=1)).trajectory for name, case in CASES.items()
    }


Run = Callable[[str, str], Execution]


@pytest.fixture(scope="module")
def run(source: Source, arm: Model, plans: dict[str, Trajectory]) -> Run:
    """One trial of a cycle after its run-in, by scenario and target; each once."""
    made: dict[tuple[str, str], Execution] = {}

    def on(name: str, target: str) -> Execution:
        if (name, target) not in made:
            board = SIMULATED[target]
            made[name, target] = execute(
                arm,
                source.compiled.controller(board.build),
                plans[name],
                ExecutionSettings(trials=1, cycles=1),
                board=board.board,
            )
        return made[name, target]

    return on


def test_the_scenarios_are_what_they_are_called(plans: dict[str, Trajectory]) -> None:
    assert all(plan.springs for plan in plans.values())
    assert [phase.coordinates for phase in plans["scenario1"].phases] == ["q", "q"]
    assert "w" in [phase.coordinates for phase in plans["scenario2"].phases]


@pytest.mark.parametrize("target", EMULATED)
@pytest.mark.parametrize("name", CASES)
def test_the_emulated_firmware_does_what_the_host_build_does(run: Run, name: str, target: str) -> None:
    found, expected = run(name, target), run(name, "simulation")
    assert expected.completed
    assert found.document().to_json()["status"] == "done"
    for field in ("t", "q", "q_desired", "tau", "saturated"):
        np.testing.assert_array_equal(getattr(found.trials[0], field), getattr(expected.trials[0], field))


@pytest.mark.parametrize("name", CASES)
def test_the_motion_is_that_of_the_plan(run: Run, name: str) -> None:
    """Its cost with the friction of the model; where friction is not compensated, the plate is pressed down less."""
    document = run(name, "simulation").document().to_json()
    assert document["mean"]["total"] == pytest.approx(document["plan"]["modelled"]["total"], rel=0.05)
    if name == "scenario2":
        assert document["plan"]["compression"] == pytest.approx(0.05, abs=1e-4)
        assert 0.02 < document["mean"]["compression"] < 0.05


def called(*arguments: object) -> int:
    return output.run(app, [str(a) for a in arguments])


@pytest.fixture(scope="module")
def compared(
    source: Source, plans: dict[str, Trajectory], tmp_path_factory: pytest.TempPathFactory
) -> Callable[[str], dict[str, Any]]:
    """By target: what the command line says of the execution and of its recording. A damper at the plate is hidden."""
    here = tmp_path_factory.mktemp("compared")
    (here / "arm.toml").write_text(source.text)
    plans["scenario2"].write(here / "plan.json")

    def by(on: str) -> dict[str, Any]:
        run, mounted = here / f"{on}.csv.gz", here / f"{on}.toml"
        options = ("--hide", HIDDEN[0], "--trials", 1, "--cycles", 1, "--out", run, "--model-out", mounted)
        status = called("execute", here / "arm.toml", here / "plan.json", "--on", on, *options, "--json", here / "e")
        assert status == 0
        assert called("compare", mounted, run, "--json", here / "c") == 0
        return {"execute": json.loads((here / "e").read_text()), "compare": json.loads((here / "c").read_text())}

    return functools.cache(by)


@pytest.mark.parametrize("target", EMULATED)
def test_its_recording_goes_through_compare(compared: Callable[[str], dict[str, Any]], target: str) -> None:
    """The comparison finds the same, whoever drove the arm."""
    found, expected = compared(target), compared("simulation")
    assert found["execute"]["on"] == target
    assert found["execute"]["image"]["target"] == "cortex-m4f"
    assert expected["execute"]["image"] is None
    assert len(found["compare"]["joints"]) == 4
    assert found["compare"]["joints"] == expected["compare"]["joints"]

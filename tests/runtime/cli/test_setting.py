"""Settings are declared once: the command line's options and their ranges are those of the dataclasses."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass
from typing import Annotated, Any

import pytest
import typer
from typer.testing import CliRunner

from runtime.cli.options import with_settings
from runtime.execution.options import ExecutionSettings
from runtime.experiments.options import ExperimentSettings
from runtime.hardware.settings import TRACKING
from runtime.planning.settings import PlanningSettings
from runtime.setting import Checked, Setting, SettingError, declared
from runtime.simulation.options import SimulationSettings

ALL = (ExecutionSettings, ExperimentSettings, PlanningSettings, SimulationSettings)


@dataclass(frozen=True)
class Pace(Checked):
    speed: Annotated[float, Setting("m/s, of the belt.", 0.5, 2.0)] = 1.0
    steps: Annotated[int | None, Setting("Of the belt.", low=1)] = None
    back: Annotated[bool, Setting("Backwards.")] = False
    smooth: Annotated[bool | None, Setting("Without jerks; if not given, as the belt likes.")] = None


@pytest.fixture
def told() -> list[Any]:
    return []


@pytest.fixture
def verb(told: list[Any]) -> typer.Typer:
    app = typer.Typer(rich_markup_mode=None)

    @app.command()
    @with_settings
    def walk(pace: Pace = Pace(), rest: Annotated[int, Setting("s, in between.", high=9)] = 3) -> None:
        told.extend([pace, rest])

    return app


def test_options_are_made_of_fields(verb: typer.Typer, told: list[Any]) -> None:
    arguments = ["--speed", "1.5", "--steps", "4", "--back", "--no-smooth", "--rest", "8"]
    assert CliRunner().invoke(verb, arguments).exit_code == 0
    assert told == [Pace(1.5, 4, True, False), 8]


def test_without_options_the_defaults_hold(verb: typer.Typer, told: list[Any]) -> None:
    assert CliRunner().invoke(verb, []).exit_code == 0
    assert told == [Pace(), 3]


def test_help_says_ranges_and_defaults(verb: typer.Typer) -> None:
    text = " ".join(CliRunner().invoke(verb, ["--help"], env={"COLUMNS": "200"}).output.split())
    assert "m/s, of the belt. [default: 1.0; 0.5<=x<=2.0]" in text
    assert "Of the belt. [x>=1]" in text
    assert "--smooth / --no-smooth" in text
    assert "--no-back" not in text


@pytest.mark.parametrize("arguments", [["--speed", "3"], ["--steps", "0"], ["--rest", "10"]])
def test_a_range_holds_on_the_command_line(verb: typer.Typer, told: list[Any], arguments: list[str]) -> None:
    assert CliRunner().invoke(verb, arguments).exit_code == 2
    assert told == []


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"speed": 3.0}, "speed is 3.0; expected 0.5 to 2"),
        ({"speed": float("nan")}, "speed is nan; expected 0.5 to 2"),
        ({"speed": "fast"}, "speed is 'fast'; expected 0.5 to 2"),
        ({"steps": 0}, "steps is 0; expected at least 1"),
        ({"steps": True}, "steps is True; expected at least 1"),
    ],
)
def test_a_range_holds_wherever_it_is_said(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(SettingError) as caught:
        Pace(**wrong)
    assert str(caught.value) == message


@pytest.mark.parametrize("settings", ALL)
def test_every_setting_has_a_default_within_its_range(settings: type[Checked]) -> None:
    settings()
    for item in declared(settings):
        assert item.setting.help.endswith(".")
        if item.setting.low is not None:
            with pytest.raises(SettingError):
                settings(**{item.name: item.setting.low - 1})
        if item.setting.high is not None:
            with pytest.raises(SettingError):
                settings(**{item.name: item.setting.high + 1})


def test_the_limit_of_tracking_is_the_one_that_is_said() -> None:
    said = next(item.setting.help for item in declared(ExecutionSettings) if item.name == "tracking_limit")
    assert f"{TRACKING['revolute']} rad, {TRACKING['prismatic']} m" in said


def test_the_declarations_import_nothing_slow() -> None:
    """--help reads them."""
    names = ", ".join(sorted({settings.__module__ for settings in ALL}))
    script = f"import sys, {names}; print(sorted({{'numpy', 'scipy', 'casadi', 'sympy'}} & sys.modules.keys()))"
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"

"""What the terminal says, from made-up dictionaries of the kind that --json writes."""

from __future__ import annotations

import re
from typing import Any

import pytest

from runtime.report.terminal import cells, loop_pages


def delay(joint: int, value: float) -> dict[str, Any]:
    return {"joint": joint, "value": value, "unit": "s", "interval": None, "assumed": value, "estimated": 0.0}


@pytest.mark.parametrize(
    ("values", "places"),
    [
        ([5e-4], ["joint 1: 0.5 ms"]),
        ([5e-4, 5e-4, 5e-4], ["every joint: 0.5 ms"]),
        ([5e-4, 2e-3, 5e-4], ["joints 1, 3: 0.5 ms", "joint 2: 2 ms"]),
    ],
)
def test_joints_of_one_delay_share_a_line(
    values: list[float], places: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    cells.delay_lines({"delay": [delay(i, value) for i, value in enumerate(values, 1)]})
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(" (")[0] for line in lines] == [f"Delay from torque to motion, {where}" for where in places]


def weighed(effect: str, delta_bic: float, share: float, failed: list[str]) -> dict[str, Any]:
    evidence = {"eff": 0.3, "share_of_excess": share, "delta_bic": delta_bic, "cv_gain": 0.9, "failed_gates": failed}
    return {"effect": effect, "joint": 1, "evidence": evidence}


def test_what_was_not_chosen_is_said_with_the_reason(capsys: pytest.CaptureFixture[str]) -> None:
    """Nearly all of what is missing is explained by many effects: the share alone reads as a contradiction."""
    finding = weighed("stribeck", 900.0, 1.0, []) | {
        "rms_before": 0.3,
        "rms_after": 0.1,
        "share": 0.998,
        "held_out_before": None,
        "parameters": {},
        "rivals": [],
        "remainder": "",
        "ranking": [
            weighed("stribeck", 900.0, 1.0, []),
            weighed("viscous_power", 700.0, 0.997, []),
            weighed("friction_patch", 950.0, 0.9, []),
            weighed("lugre", 100.0, 0.4, ["held-out error does not fall by 0.3 %", "another"]),
            weighed("offset", 1.0, 0.01, []),
        ],
    }
    loop_pages._finding(finding, {"joints": [{"joint": 1, "unit": "N m"}], "findings": [finding]})
    said = [line for line in capsys.readouterr().out.splitlines() if "rather" in line]
    assert said == [
        "  rather than viscous_power at joint 1, which by itself would explain 99.7 % of what was missing, "
        "but BIC prefers stribeck by 200",
        "  rather than friction_patch at joint 1, which by itself would explain 90.0 % of what was missing, "
        "but with it added and everything fitted again, the error falls less",
        "  rather than lugre at joint 1, which by itself would explain 40.0 % of what was missing, "
        "but held-out error does not fall by 0.3 %",
    ]


@pytest.mark.parametrize("columns", [80, 140])
def test_parameters_of_a_long_arm_fit_a_narrow_screen(
    columns: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Where there is no room for the joints' names, their numbers stand alone; no number and no heading is broken."""
    monkeypatch.setattr(cells.sys.stdout, "isatty", lambda: True)
    monkeypatch.setenv("COLUMNS", str(columns))
    known = {"interval": [-0.0007479, 0.001908], "unit": "kg m^2", "model": -0.0002842, "fit": -0.0001335}
    document = {
        "inertial": [{"joint": 6, "name": "YY6", **known}],
        "rotors": [],
        "effects": [{"name": "coulomb_asymmetric", "joint": 6, "parameters": {"positive": {"value": 1.2345, **known}}}],
    }
    cells.fit_table(document, {6: "shoulder_lift_joint"})
    out = re.sub(r"\x1b\[[0-9;]*m", "", capsys.readouterr().out)
    assert max(map(len, out.splitlines())) <= columns
    assert ("shoulder_lift_joint" in out) is (columns == 140)
    assert len(out.splitlines()) < 10
    for whole in ("parameter", "interval", "[-0.0007479,", "0.001908]", "-0.0001335", "kg"):
        assert whole in out

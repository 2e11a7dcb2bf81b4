"""What the terminal says, from made-up dictionaries of the kind that --json writes."""

from __future__ import annotations

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

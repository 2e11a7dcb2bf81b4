"""Several recordings of one arm: the same arm, another one, and the same arm at another temperature."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from runtime.diagnosis.diagnose import begin, conclude, diagnose
from runtime.model.loader import Model
from runtime.recordings.recording import Recording
from runtime.report import loop, terminal
from runtime.report.page.html_page import render
from runtime.report.summary import ResultSummary

from .bench import Setting, bench, specimen
from .bodies import ARMS, BELIEVED, model_text
from .hidden import Hidden, Put, Rows, at
from .line import opened
from .motion import desired

JOINTS = 2
MORE = 0.3  # kg at the end-effector


@pytest.fixture(scope="module")
def model() -> Model:
    return opened(model_text(ARMS[JOINTS], BELIEVED)).compiled.model()


@pytest.fixture(scope="module")
def record() -> Callable[[int, str, Put | None], Recording]:
    """Half of a motion of its own, by the same specimen of the arm, with something put into it or not."""
    rows = specimen(ARMS[JOINTS], BELIEVED, np.random.default_rng(5))

    def make(seed: int, name: str, put: Put | None = None) -> Recording:
        rng = np.random.default_rng(seed)
        wanted = desired(rng, JOINTS, "no_repeat")[..., :30_000]
        plant = bench(Setting(joints=JOINTS), wanted, rng, False, rows)
        hidden = [] if put is None else [(Hidden("", 1.0, (0.0, 1.0), put), 0, 1.0)]
        return replace(plant.recording(plant.run(hidden)), path=Path(name))

    return make


def carrying(_rows: Rows, arm: dict[str, float], _amount: float) -> None:
    arm.update(PAYLOAD=MORE, PAYLOAD_TIME=0.0)


def test_recordings_of_one_arm_agree(model: Model, record: Callable[..., Recording]) -> None:
    found = diagnose(model, [record(1, "run1.csv"), record(2, "run2.csv")]).document().to_json()
    assert found["verdict"] == "clean", found["reason"]
    assert found["inconsistent"] == []
    assert [r["recording"] for r in found["recordings"]] == ["run1.csv", "run2.csv"]
    for row, common in zip(found["recordings"][0]["parameters"], found["parameters"], strict=True):
        assert set(row) >= {"joint", "name", "unit", "model", "fit", "interval"}
        assert row["fit"] == pytest.approx(common["fit"], rel=0.05)


def test_another_payload_is_another_arm(model: Model, record: Callable[..., Recording]) -> None:
    found = diagnose(model, [record(1, "run1.csv"), record(2, "run2.csv", carrying)]).document().to_json()
    assert found["verdict"] == "refused", found["reason"]
    assert found["findings"] == []
    worst = found["inconsistent"][0]
    assert worst["recordings"] == ["run1.csv", "run2.csv"]
    assert worst["values"][1] > worst["values"][0]
    for text in ("run1.csv", "run2.csv", worst["name"]):
        assert text in found["reason"]


def test_thinner_grease_is_said_and_refused(model: Model, record: Callable[..., Recording]) -> None:
    thin = {"VISCOUS_POSITIVE": 0.77, "VISCOUS_NEGATIVE": 0.77}
    found = diagnose(model, [record(1, "run1.csv"), record(2, "run2.csv", at(0, **thin))]).document().to_json()
    assert found["verdict"] == "refused", found["reason"]
    assert found["findings"] == []
    assert "viscous@1 coefficient is " in found["reason"]


def test_page_and_terminal_show_both_tables(
    model: Model, record: Callable[..., Recording], capsys: pytest.CaptureFixture[str]
) -> None:
    search = begin(model, [record(1, "run1.csv"), record(2, "run2.csv", carrying)])
    found = conclude(search)
    page = render(found)
    assert "Each recording alone" in page
    assert page.count("differs</span>") == len(found.document().to_json()["inconsistent"])
    terminal.show(loop.diagnosis(ResultSummary(found).document))
    out = capsys.readouterr().out
    assert re.search(r"each recording alone +run1.csv +run2.csv", out)
    assert "They disagree on " in out

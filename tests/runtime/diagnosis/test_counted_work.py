"""Work is counted, not the clock: the same files give the same JSON at any load and with any number of processes."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from runtime.cli import output
from runtime.cli.main import app
from runtime.diagnosis.candidates import FittedBase
from runtime.diagnosis.stages import diagnose
from runtime.identification.regressors import Regressors
from runtime.model.terms import Term
from runtime.progress import on_cores, within
from runtime.recordings.recording import write
from runtime.report.reasons import reason
from runtime.simulation.demo import record_files
from tests import bank

Run = Callable[..., tuple[int, bytes]]
SIX = ("diagnose", "six.toml", "six.csv")
DEMO = ("improve", "drive", "fitted.csv.gz", "--held-out", "held_out.csv.gz")


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Exit status and bytes of --json of a verb, with so many processes and a clock so many times as fast."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "86400")
    record_files(tmp_path)
    Path("six.toml").write_text(bank.TEXTS["six"], encoding="utf-8")
    write(Path("six.csv"), bank.recording("six coupled"))

    def run(cores: int, fast: int, *command: str) -> tuple[int, bytes]:
        clock = time.monotonic
        with monkeypatch.context() as patch, on_cores(cores):
            patch.setattr(time, "monotonic", lambda: fast * clock())
            status = output.run(app, [*command, "--json", "found.json"])
        return status, Path("found.json").read_bytes()

    return run


@pytest.mark.parametrize(("command", "named"), [(DEMO, b"stribeck"), (SIX, b"coupled_gear")])
def test_the_answer_is_the_same_at_any_load(run: Run, command: tuple[str, ...], named: bytes) -> None:
    status, found = run(1, 1, *command)
    assert (status, named in found, json.loads(found)["search"]["ended"]) == (0, True, "complete")
    assert run(8, 30, *command) == (status, found)
    if command is DEMO:
        assert run(2, 1, *command) == (status, found)


def test_a_search_that_is_cut_says_so_and_calls_nothing_clean(run: Run) -> None:
    write(Path("more.csv"), bank.recording("six coupled and more"))
    command = ("improve", "six.toml", "more.csv", "--budget", "2")
    status, cut = run(1, 1, *command)
    assert run(8, 30, *command) == (status, cut) == (1, cut)
    found = json.loads(cut)
    assert found["search"] == {"refits": 2, "budget": 2, "ended": "budget"}
    assert found["reason"].split(". ")[1].startswith("The search was cut by its budget of 2 refits:")
    assert [step["added"] for step in found["history"]] == [None, "coupled_gear@5"]
    assert {joint["verdict"] for joint in found["joints"]} == {"refused"}
    assert found["would_have_seen"] == []


def test_a_time_limit_ends_the_search_or_the_limits_after_it() -> None:
    with within(0.0):
        none = diagnose(bank.model("drive"), [bank.recording("clean")])
    assert (none.verdict, none.search.ended, none.seen) == ("refused", "time", ())
    assert reason(none).split(". ")[1].startswith("The search was cut by its time limit after 0 of")
    clean = bank.diagnosed("clean")
    assert (clean.verdict, clean.search.ended) == ("clean", "complete")
    some = clean.within(clean.seen[:3], len(clean.seen) - 3)
    assert (some.verdict, some.search.ended, len(some.seen)) == ("refused", "time", 3)


def test_columns_are_the_same_alone_and_among_others() -> None:
    """To the last bit: which are computed together depends on what other processes have computed."""
    fit = bank.identified("six coupled")
    base = FittedBase(fit)
    for term in (Term("stribeck", 2), Term("elasticity", 2), Term("lugre", 2)):
        shapes = base.choices(term)[:9]
        among = Regressors(base.model, replace(fit.motion), fit.prediction).columns_each(term, 1, shapes)
        for shape, found in zip(shapes, among, strict=True):
            alone = Regressors(base.model, replace(fit.motion), fit.prediction).columns(term, 1, shape)
            np.testing.assert_array_equal(alone, found)

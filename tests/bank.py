"""Recordings by name, each made once and identified, compared and diagnosed once: what tests assert things over.

They come from equations written apart from the library's: `plants` (the drive), `wrist` (two motors that turn with two
joints), `spatial_wrist` (six joints). What is computed from them is kept, see `kept`.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pytest

from runtime.diagnosis.candidates import FittedBase
from runtime.diagnosis.grammar_search import Draft
from runtime.diagnosis.ranking import rank
from runtime.diagnosis.stages import begin, diagnose, follow
from runtime.diagnosis.steps import Trail
from runtime.diagnosis.verdict import Diagnosis
from runtime.fit_warnings import Suspicion, suspicions
from runtime.identification.compare import Comparison, compare
from runtime.identification.fit import Fit
from runtime.identification.identify import identify
from runtime.loop.improve import propose
from runtime.model.loader import Model
from runtime.model.terms import Term
from runtime.recordings.recording import Recording
from runtime.report.reasons import closed_gates
from runtime.workspace.source import Source
from tests import plants, spatial_wrist, wrist
from tests.judge import bodies
from tests.judge.cases import Case
from tests.judge.line import Line, line
from tests.kept import kept
from tests.sources import ROOT

ARMS = ROOT / "symbolic" / "arms"
TEXTS = {
    "drive": (ARMS / "drive.toml").read_text(encoding="utf-8"),
    "wrist": wrist.MODEL,
    "six": spatial_wrist.MODEL,
    **{f"judge{n}": bodies.model_text(bodies.ARMS[n], bodies.BELIEVED) for n in (1, 2)},
}
"""Model files by the arm's name."""


@dataclass(frozen=True)
class Entry:
    """A recording: of which arm, and the call that makes it."""

    arm: str
    make: Callable[..., Recording]
    arguments: tuple[object, ...]


def drive(hidden: str | None, seed: int, size: float | None = None) -> Entry:
    """The drive of `plants`, 77 s at 1 kHz, the same motion twice."""
    return Entry("drive", plants.recording, (hidden, seed, size))


def pair(motor: wrist.CoupledMotor, seed: int) -> Entry:
    """Two joints of parallel axes."""
    return Entry("wrist", wrist.record, (motor, seed))


def six(motor: wrist.CoupledMotor, seed: int, beside: spatial_wrist.Beside | None = None) -> Entry:
    """Six joints in space, 9 s."""
    arguments = (motor, seed, 9.0) if beside is None else (motor, seed, 9.0, beside)
    return Entry("six", spatial_wrist.record, arguments)


NONE = wrist.CoupledMotor()
COUPLED = wrist.CoupledMotor(1.4, 0.7, 0.01)
ENTRIES = {
    "clean": drive(None, 21),
    "parallel spring": drive("parallel_spring", 11),
    "viscous asymmetric": drive("viscous_asymmetric", 11),
    "linear spring": drive("linear_spring", 3),
    "linear spring again": drive("linear_spring", 4),
    "friction wave": drive("friction_wave", 5),
    "friction wave again": drive("friction_wave", 6),
    "disturbance": drive("disturbance", 21),
    "elasticity": drive("elasticity", 1),
    "pair clean": pair(NONE, 3),
    "pair coupled": pair(wrist.CoupledMotor(0.5, 0.4, 0.03, 1.0), 3),
    "pair coupled backwards": pair(wrist.CoupledMotor(0.5, 0.4, 0.03, -1.0), 3),
    "pair rubbing": pair(wrist.CoupledMotor(dry=0.4), 3),
    "six clean": six(NONE, 4),
    "six coupled": six(COUPLED, 4),
    "six coupled and more": six(COUPLED, 4, spatial_wrist.Beside(1.0, 0.05)),
}


@cache
def source(arm: str) -> Source:
    """The model file of an arm of the bank."""
    return Source(Path(f"{arm}.toml"), TEXTS[arm])


@cache
def model(arm: str) -> Model:
    """The compiled arm of the bank."""
    return source(arm).compiled.model()


def recording(name: str) -> Recording:
    entry = ENTRIES[name]
    return kept(entry.make, *entry.arguments)


def identified(name: str) -> Fit:
    return kept(identify, model(ENTRIES[name].arm), [recording(name)])


def compared(name: str) -> Comparison:
    return kept(compare, model(ENTRIES[name].arm), [recording(name)])


def diagnosed(name: str) -> Diagnosis:
    return kept(diagnose, model(ENTRIES[name].arm), [recording(name)])


def searched(name: str) -> Trail:
    """The findings one after another, before any is looked at anew in the light of the others."""
    return kept(advanced, model(ENTRIES[name].arm), [recording(name)])


def advanced(model: Model, recordings: Sequence[Recording]) -> Trail:
    return follow(begin(model, recordings))


def suspected(model: Model, recordings: Sequence[Recording]) -> tuple[Suspicion, ...]:
    """What is found wrong with recordings."""
    return suspicions(identify(model, recordings))


def proposed(arm: Model, recordings: Sequence[Recording], wider: Model, guesses: Collection[str]) -> Draft | None:
    """As `tendon diagnose --draft` calls it."""
    return propose(kept(diagnose, arm, recordings), wider, guesses)


def doubts(model: Model, recordings: Sequence[Recording], terms: Sequence[Term]) -> dict[str, str]:
    """What speaks against each of these candidates on the model as it is."""
    fitted = identify(model, recordings)
    floors = [float(x) for x in fitted.motion.band.torque_floor()]
    ranked = rank(FittedBase(fitted), terms, floors).candidates
    return {str(c.term): "; ".join(closed_gates(c, model)) for c in ranked}


def gains(model: Model, recordings: Sequence[Recording]) -> dict[Term, float]:
    """By how much of the squared error each candidate lowers it."""
    base = begin(model, recordings).last.base
    found = {term: base.search(term) for term in base.terms()}
    whole = base.excerpt[1].solution.sse
    return {term: candidate.fall / whole for term, candidate in found.items() if candidate is not None}


def judged(case: Case) -> Line:
    """A row of the judge's table. RuntimeError where it could not be made."""
    row = line(case)
    if row.outcome == "failed":
        raise RuntimeError(row.reason)
    return row


class KeptVerbs:
    """Lets `tendon diagnose` and its --draft take what they find from the bank; all else they do themselves."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        patch.setattr("runtime.diagnosis.stages.diagnose", self._diagnose)
        patch.setattr("runtime.loop.improve.propose", self._propose)

    def _diagnose(self, arm: Model, recordings: Sequence[Recording], budget: int) -> Diagnosis:  # noqa: ARG002
        self.asked = arm, recordings
        return kept(diagnose, *self.asked)

    def _propose(self, _: Diagnosis, wider: Model, guesses: Collection[str]) -> Draft | None:
        return kept(proposed, *self.asked, wider, guesses)

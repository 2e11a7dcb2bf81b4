"""An arm, its recordings and the results of verbs, as a notebook holds them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import Any

from runtime import files
from runtime.diagnosis.credibility import JudgedFit
from runtime.diagnosis.verdict import Diagnosis
from runtime.documents.fits import JudgedFitDocument
from runtime.documents.models import ExportDocument
from runtime.documents.plans import OptimizeDocument
from runtime.identification.compare import Comparison
from runtime.loop.improve import Improvement
from runtime.model.loader import Model
from runtime.model.terms import structure
from runtime.plain_json import plain
from runtime.planning.optimize import Plan
from runtime.planning.results import document as plan_document
from runtime.recordings.recording import Recording, read
from runtime.report import diagnosed, fits, loop, models, motions, terminal
from runtime.report.page import page_figures
from runtime.report.page.motion_pages import plan_page
from runtime.report.page.page_figures import Drawn
from runtime.report.page.reports import write_report
from runtime.report.plots import motion_plots
from runtime.report.sections import Section
from runtime.report.summary import LoopDocument, ResultSummary
from runtime.workspace.source import Source

PathOrText = str | PathLike[str]
Recorded = Recording | PathOrText
"""A recording, or the file in which one stands."""


@dataclass(frozen=True)
class LoadedArm:
    """A model file, its equations derived and compiled; `text` is what would be written.

    source   the file as read, and the library of effects
    told     what was said of it when it was made
    """

    source: Source
    told: tuple[str, ...] = ()

    @property
    def text(self) -> str:
        """The model file, with everything that was added or identified here."""
        return self.source.text

    @cached_property
    def model(self) -> Model:
        """The generated functions on NumPy arrays, samples last: `arm.model.inverse_dynamics(q, qd, qdd)`."""
        return self.source.compiled.model()

    @property
    def notes(self) -> tuple[str, ...]:
        """What a person should know of the file beside errors, a line each."""
        return (*self.told, *self.source.arm().notes)

    def with_text(self, text: str) -> LoadedArm:
        """The same arm with another model file's text; nothing is written."""
        return LoadedArm(self.source.with_text(text))

    def recordings(
        self, given: Recorded | Sequence[Recorded], columns: Mapping[str, str] | None = None, allow_gaps: bool = False
    ) -> list[Recording]:
        """One or several recordings or files, read and checked against this arm."""
        one = isinstance(given, Recording | str | PathLike)
        entries: list[Recorded] = [given] if one else list(given)  # type: ignore[arg-type,list-item]
        return [
            entry if isinstance(entry, Recording) else self.source.recordings([Path(entry)], columns, allow_gaps)[0]
            for entry in entries
        ]

    def save(self, path: PathOrText) -> None:
        """Write the model file. Raises OSError."""
        files.replace(Path(path), self.text.encode())

    def __repr__(self) -> str:
        model = self.model
        effects = ", ".join(map(str, structure(model))) or "no effects"
        kinds = ", ".join(joint.type for joint in model.joints)
        return f"{model.name}: {model.n} joint{'s' if model.n > 1 else ''} ({kinds})\n{effects}"


def load(model: PathOrText, effects: PathOrText | None = None) -> LoadedArm:
    """The arm of a model file, or by its name one that ships with Tendon: "drive", "vishard4", "emps", "ur10", "panda".

    effects   a Python file with effects of your own (`--effects`); it is run, so trust it
    Derived and compiled when it is first needed; later calls find it in the cache. Raises ValueError, OSError.
    """
    own = None if effects is None else Path(effects)
    return LoadedArm(Source.read(Path(model), own))


def recording(
    path: PathOrText,
    arm: LoadedArm | PathOrText | None = None,
    columns: Mapping[str, str] | None = None,
    allow_gaps: bool = False,
) -> Recording:
    """A recording, read into arrays in SI and checked; see runtime/README.md for the format.

    arm         whose joints' types and torque constants the units follow; None: revolute joints
    columns     signal -> header cell, for other headers: {"q1": "Position1 [deg]"} (`--map`)
    allow_gaps  split at gaps and drop rows with a NaN, instead of refusing them
    Raises ValueError with the file and the line.
    """
    if arm is None:
        return read(Path(path), None, columns, allow_gaps)
    whose = arm if isinstance(arm, LoadedArm) else load(arm)
    return whose.recordings(path, columns, allow_gaps)[0]


class ResultFigures(tuple[Drawn, ...]):
    """Figures of a result; the last line of a cell draws them all, an item one of them."""

    __slots__ = ()

    def __repr__(self) -> str:
        return "\n".join(f"[{k}] {figure.caption}" for k, figure in enumerate(self))

    def _repr_html_(self) -> str:
        return "".join(figure._repr_html_() for figure in self)


class _Result(ABC):
    """What all results have in common: `result` says a few lines, `result.show()` what the terminal says."""

    _sections: Callable[[Any], Sequence[Section]]

    @property
    @abstractmethod
    def document(self) -> Any:
        """Every figure, as a struct of runtime/documents."""

    @cached_property
    def json(self) -> Any:
        """The same as plain dicts and lists, as --json writes it."""
        return plain(self.document)

    def __repr__(self) -> str:
        return "\n".join(loop.in_short(self.document))

    def show(self) -> None:
        """Print what the command line prints."""
        terminal.show(type(self)._sections(self.document))


@dataclass(frozen=True, repr=False)
class IdentificationResult(_Result):
    """arm: with the values that were identified in its text."""

    judged: JudgedFit
    arm: LoadedArm

    _sections = staticmethod(fits.identification)

    @cached_property
    def document(self) -> JudgedFitDocument:
        """As `tendon identify --json`, but for what was written."""
        return diagnosed.judged(self.judged)

    def save(self, path: PathOrText) -> None:
        """Write the model file with the identified values. Raises OSError."""
        self.arm.save(path)


class _Loop(_Result):
    """Results that have steps of a model, each fitted: they draw figures and write a report."""

    summary: ResultSummary

    @property
    def document(self) -> LoopDocument:
        """As --json writes it."""
        return self.summary.document

    @cached_property
    def figures(self) -> ResultFigures:
        """The error, then every joint's torque and residual."""
        return ResultFigures(page_figures.of_result(self.summary))

    def report(self, directory: PathOrText) -> Path:
        """Write the HTML page into a directory; its path. Raises OSError."""
        return write_report(Path(directory), self.summary)


@dataclass(frozen=True, repr=False)
class ComparisonResult(_Loop):
    """Where the model fails."""

    comparison: Comparison
    summary: ResultSummary

    _sections = staticmethod(fits.comparison)


@dataclass(frozen=True, repr=False)
class DiagnosisResult(_Loop):
    """Which effect is missing."""

    diagnosis: Diagnosis
    summary: ResultSummary

    _sections = staticmethod(loop.diagnosis)

    @property
    def verdict(self) -> str:
        """ "effect", "clean", "unexplained" or "refused"."""
        return self.diagnosis.verdict


@dataclass(frozen=True, repr=False)
class ImprovementResult(_Loop):
    """What was added, and how the error fell; arm: the improved one."""

    improvement: Improvement
    summary: ResultSummary
    arm: LoadedArm

    _sections = staticmethod(loop.improvement)

    def save(self, path: PathOrText) -> None:
        """Write the improved model file. Raises OSError."""
        self.arm.save(path)


@dataclass(frozen=True, repr=False)
class PlanResult(_Result):
    """A planned motion; arm: with the plan's springs and contact in its text."""

    plan: Plan
    arm: LoadedArm

    _sections = staticmethod(motions.plan)

    @cached_property
    def document(self) -> OptimizeDocument:
        """As `tendon optimize --json`."""
        return plan_document(self.arm.model, self.plan)

    def __repr__(self) -> str:
        return "\n".join([motions.plan_headline(self.document), *motions.spring_lines(self.document)])

    @cached_property
    def figures(self) -> ResultFigures:
        """Positions and torques of one cycle."""
        figure = motion_plots.plan(self.document)
        return ResultFigures([page_figures.drawn(figure, "plan", "Positions and torques of one cycle.")])

    def report(self, directory: PathOrText) -> Path:
        """Write the HTML page into a directory; its path. Raises OSError."""
        return plan_page(self.arm.model, self.plan.trajectory, self.document).write(Path(directory))

    def save(self, path: PathOrText) -> None:
        """Write the trajectory, for `tendon execute`. Raises OSError."""
        self.plan.trajectory.write(Path(path))


@dataclass(frozen=True, repr=False)
class ExportResult(_Result):
    """An arm that was written for simulators: its bodies, and what the format cannot say."""

    written: ExportDocument

    _sections = staticmethod(models.exported)

    @property
    def document(self) -> ExportDocument:
        """As `tendon export --json`."""
        return self.written

    def __repr__(self) -> str:
        return "\n".join([f"{self.written.out}: {self.written.name}", *models.export_notes(self.written)])

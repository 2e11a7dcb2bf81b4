"""The results of verbs, as a notebook shows them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from runtime.diagnosis.credibility import JudgedFit
from runtime.diagnosis.verdict import Diagnosis
from runtime.documents.fits import JudgedFitDocument
from runtime.documents.models import ExportDocument
from runtime.documents.plans import OptimizeDocument
from runtime.identification.compare import Comparison
from runtime.loop.improve import Improvement
from runtime.notebook.arm import LoadedArm, PathOrText
from runtime.plain_json import plain
from runtime.planning.optimize import Plan
from runtime.planning.results import document as plan_document
from runtime.report import diagnosed, fits, loop, models, motions, terminal
from runtime.report.page import page_figures
from runtime.report.page.motion_pages import plan_page
from runtime.report.page.page_figures import Drawn
from runtime.report.page.reports import write_report
from runtime.report.plots import motion_plots
from runtime.report.sections import Section
from runtime.report.summary import LoopDocument, ResultSummary


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

"""The results of verbs, as a notebook shows them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, Literal, TypeVar, cast

from runtime.diagnosis.credibility import JudgedFit
from runtime.diagnosis.verdict import Diagnosis
from runtime.documents.diagnosis import (
    DiagnosedJoint,
    DiagnosisDocument,
    FindingEntry,
    HistoryEntry,
    ImprovementDocument,
    LimitEntry,
)
from runtime.documents.fits import (
    ComparedJoint,
    CompareDocument,
    FittedEffect,
    InertialEntry,
    JointEntry,
    JudgedFitDocument,
)
from runtime.documents.parts import Document, given
from runtime.documents.recordings import DeterminedParameter, InspectDocument, SuspicionEntry
from runtime.identification.compare import Comparison
from runtime.inspection.inspection import Inspection
from runtime.loop.improve import Improvement
from runtime.notebook.arm import LoadedArm, PathOrText
from runtime.plain_json import plain
from runtime.recordings.recording import Recording
from runtime.report import diagnosed, fits, loop, recordings, terminal
from runtime.report.sections import Section
from runtime.report.summary import ResultSummary

if TYPE_CHECKING:
    from runtime.notebook.html import ResultFigures  # Matplotlib, CasADi and the pages are imported where used


D = TypeVar("D", bound=Document)
J = TypeVar("J", DiagnosisDocument, ImprovementDocument)


class VerbResult(ABC, Generic[D]):
    """What all results have in common. Printed it says a few lines; in a notebook everything else is folded below."""

    _sections: Callable[[Any], Sequence[Section]]
    _in_short: Callable[[Any], Sequence[str]] = staticmethod(loop.in_short)

    @property
    @abstractmethod
    def document(self) -> D:
        """Every figure, as a struct of runtime/documents: what --json of the verb writes."""

    def to_dict(self) -> dict[str, Any]:
        """Every figure as plain dicts, lists and numbers, with the keys of --json."""
        made: dict[str, Any] = plain(self.document)
        return made

    @property
    def json(self) -> dict[str, Any]:
        """The same as `to_dict()`."""
        return self.to_dict()

    def __repr__(self) -> str:
        return "\n".join(type(self)._in_short(self.document))

    def _repr_html_(self) -> str:
        from runtime.notebook import html

        return html.shown(repr(self).splitlines(), type(self)._sections(self.document))

    def show(self) -> None:
        """Print what the command line prints."""
        terminal.show(type(self)._sections(self.document))


@dataclass(frozen=True, repr=False)
class MadeResult(VerbResult[D]):
    """A result whose figures were all made with it."""

    made: D

    @property
    def document(self) -> D:
        return self.made


@dataclass(frozen=True, repr=False)
class IdentificationResult(VerbResult[JudgedFitDocument]):
    """The fitted parameters.

    arm   with the values that were identified in its text
    """

    judged: JudgedFit
    arm: LoadedArm

    _sections = staticmethod(fits.identification)

    @cached_property
    def document(self) -> JudgedFitDocument:
        """As `tendon identify --json`, but for what was written."""
        return diagnosed.judged(self.judged)

    @property
    def verdict(self) -> Literal["fitted", "refused"]:
        """ "refused": the fit is not to be believed, and `reason` says why."""
        return self.document.verdict

    @property
    def reason(self) -> str:
        """The verdict in one sentence."""
        return self.document.reason

    @property
    def inertial(self) -> list[InertialEntry]:
        """Base inertial parameters: `.name`, `.fit`, `.interval`, `.unit`, and `.model`, the file's value."""
        return self.document.inertial

    @property
    def effects(self) -> list[FittedEffect]:
        """The effects with their fitted values: `.effect`, `.joint`, `.parameters["torque"].value`."""
        return self.document.effects

    @property
    def joints(self) -> list[JointEntry]:
        """The residual of each joint: `.rms`, `.relative` to the torque, `.floor` of the noise."""
        return self.document.joints

    def save(self, path: PathOrText) -> None:
        """Write the model file with the identified values. Raises OSError."""
        self.arm.save(path)


class _Loop(VerbResult[D]):
    """Results that have steps of a model, each fitted: they draw figures and write a report."""

    summary: ResultSummary

    @property
    def document(self) -> D:
        return cast(D, self.summary.document)

    @cached_property
    def figures(self) -> ResultFigures:
        """The error, then every joint's torque and residual."""
        from runtime.notebook.html import ResultFigures
        from runtime.report.page import page_figures

        return ResultFigures(page_figures.of_result(self.summary))

    def report(self, directory: PathOrText) -> Path:
        """Write the HTML page into a directory; its path. Raises OSError."""
        from runtime.report.page.reports import write_report

        return write_report(Path(directory), self.summary)


@dataclass(frozen=True, repr=False)
class ComparisonResult(_Loop[CompareDocument]):
    """Where the model fails."""

    comparison: Comparison
    summary: ResultSummary

    _sections = staticmethod(fits.comparison)

    @property
    def joints(self) -> list[ComparedJoint]:
        """The residual of each joint: `.rms`, `.relative` to the torque, `.floor` of the noise, and `.structure`, the
        signals that it follows."""
        return self.document.joints


class _Judged(_Loop[J]):
    """Results with a verdict."""

    @property
    def verdict(self) -> Literal["effect", "clean", "unexplained", "refused"]:
        """On the model as given; after improve, an effect where one was added that holds, else on what is left."""
        return self.document.verdict

    @property
    def reason(self) -> str:
        """The verdict in one sentence."""
        return self.document.reason

    @property
    def joints(self) -> list[DiagnosedJoint]:
        """The residual and the verdict of each joint: `.rms`, `.relative` to the torque, `.floor`, `.verdict`."""
        return self.document.joints

    @property
    def parameters(self) -> list[InertialEntry]:
        """Base inertial parameters, fitted with all findings: `.name`, `.fit`, `.interval`, `.unit`."""
        return self.document.parameters

    @property
    def would_have_seen(self) -> list[LimitEntry]:
        """How large each other effect must be to be found in these recordings."""
        return self.document.would_have_seen


@dataclass(frozen=True, repr=False)
class DiagnosisResult(_Judged[DiagnosisDocument]):
    """Which effect is missing."""

    diagnosis: Diagnosis
    summary: ResultSummary

    _sections = staticmethod(loop.diagnosis)

    @property
    def findings(self) -> list[FindingEntry]:
        """The missing effects, the first first: `.effect`, `.joint`, `.parameters["torque"].value`, `.error_before`,
        `.error_after`, `.rivals`."""
        return self.document.findings


@dataclass(frozen=True, repr=False)
class ImprovementResult(_Judged[ImprovementDocument]):
    """What was added, and how the error fell.

    arm   the improved one
    """

    improvement: Improvement
    summary: ResultSummary
    arm: LoadedArm

    _sections = staticmethod(loop.improvement)

    @property
    def added(self) -> list[FindingEntry]:
        """The effects that were added, as `findings` of a diagnosis has them."""
        return [found for step in self.history if (found := given(step.finding)) is not None]

    @property
    def history(self) -> list[HistoryEntry]:
        """The model as given, then after each addition: `.added`, and a number a joint in `.relative`, the error, and
        `.held_out_relative`."""
        return self.document.history

    def save(self, path: PathOrText) -> None:
        """Write the improved model file. Raises OSError."""
        self.arm.save(path)


@dataclass(frozen=True, repr=False)
class InspectionResult(VerbResult[InspectDocument]):
    """What is in a recording, and what looks wrong with it.

    recording   None if it cannot be read
    """

    inspection: Inspection

    _sections = staticmethod(recordings.inspection)

    @cached_property
    def document(self) -> InspectDocument:
        """As `tendon inspect --json`."""
        return diagnosed.inspected(self.inspection)

    @property
    def recording(self) -> Recording | None:
        """The recording, with gaps split where it has any; None if it cannot be read."""
        return self.inspection.recording

    @property
    def problem(self) -> str | None:
        """Why it cannot be used as it is; None: it can."""
        return self.document.problem

    @property
    def suspicions(self) -> list[SuspicionEntry]:
        """What looks wrong: `.joint`, `.kind`, `.found`, and `.cure`, what was expected and what to do."""
        return self.document.suspicions

    @property
    def parameters(self) -> list[DeterminedParameter]:
        """How well the data determine each parameter of the arm: `.name`, `.told`, `.value`, `.interval`."""
        return self.document.parameters

    def __repr__(self) -> str:
        head = repr(self.recording) if self.recording else f"{self.document.file}: {self.document.format}"
        return "\n".join([head, *recordings.wrong(self.document)])


def several(asked: Any) -> list[Any]:
    """One number or text, or several of them, as a list."""
    return [asked] if isinstance(asked, int | str) else list(asked)

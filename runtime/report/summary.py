"""A result of the loop, the files and options it came from, and the commands that follow from it."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from msgspec import UNSET
from msgspec.structs import replace

from runtime.diagnosis.steps import Step, after_effect, physics
from runtime.diagnosis.verdict import Diagnosis
from runtime.documents.diagnosis import CommandEntry, DiagnosisDocument, FloorEntry, ImprovementDocument, PeaksEntry
from runtime.documents.fits import CompareDocument
from runtime.documents.provenance import Provenance
from runtime.documents.replays import ReplayStep
from runtime.fit_warnings import Suspicion, suspicions
from runtime.identification.compare import Comparison, JointSeries
from runtime.loop.improve import Improvement
from runtime.model.terms import Term, at, joints_of
from runtime.motion import spectra
from runtime.motion.repeats import Floor
from runtime.report import diagnosed, reasons
from runtime.wording import numbered

GUESS = Path("guess.py")
"""Where a draft of an unknown effect is proposed to go."""


@dataclass(frozen=True)
class Invocation:
    """The files and options of a command line, as they were typed.

    maps       `--map` entries
    improved   where the improved model was written, if it was
    about      what the model file says of itself
    like       the arm of Tendon that was named in place of a model file; `model` is then where a copy of it goes
    provenance   what the result was made from; None where no verb made it
    """

    model: Path
    recordings: tuple[Path, ...]
    held_out: tuple[Path, ...] = ()
    effects: Path | None = None
    maps: tuple[str, ...] = ()
    allow_gaps: bool = False
    improved: Path | None = None
    about: str = ""
    like: str | None = None
    provenance: Provenance | None = None

    def copy(self) -> str:
        """Makes the arm that was named a model file of the user's."""
        return shlex.join(["tendon", "init", "--like", str(self.like), "--out", _path(self.model)])

    def add(self, term: Term) -> str:
        """Puts an effect into the model file."""
        at = [] if term.joint is None else ["--joint", str(term.joint)]
        return self._line("add", [_path(self.model), term.effect, *at])

    def identify(self) -> str:
        """Fits the model file again and writes the values into it."""
        return self._line("identify", [_path(self.model), *self._data(), "--write"])

    def experiment(self, terms: Sequence[Term]) -> str:
        """Designs the motion that tells effects apart."""
        between = ",".join(map(str, terms))
        return self._line("experiment", [self._latest, "--between", between])

    def draft(self) -> str:
        """Drafts an effect for what nothing in the library explains."""
        return self._line("diagnose", [self._latest, *self._data(), "--draft", str(GUESS)])

    def try_draft(self) -> str:
        """Adds the draft, if it helps."""
        return shlex.join(["tendon", "improve", self._latest, *self._data(), "--effects", str(GUESS)])

    @property
    def _latest(self) -> str:
        return _path(self.improved) if self.improved else self.like or _path(self.model)

    def _data(self) -> list[str]:
        return [*map(_path, self.recordings), *reading(self.maps, self.allow_gaps)]

    def _line(self, verb: str, arguments: Sequence[str]) -> str:
        own = [] if self.effects is None else ["--effects", _path(self.effects)]
        return shlex.join(["tendon", verb, *arguments, *own])


def reading(maps: Sequence[str], allow_gaps: bool) -> list[str]:
    """The options by which recordings were read, as one would type them."""
    entries = [part for entry in maps for part in ("--map" if "=" in entry else "--columns", entry)]
    return [*entries, *(["--allow-gaps"] if allow_gaps else [])]


def about(text: str) -> str:
    """The first paragraph of the comment at the head of a model file, where its sources stand."""
    words: list[str] = []
    for line in text.splitlines():
        found = line.lstrip("#").split() if line.startswith("#") else []
        if not found:
            break
        words += found
    return " ".join(words)


def unknown(model: str) -> Invocation:
    """For a result whose files nobody named: the model's name and a word to replace."""
    return Invocation(Path(f"{model}.toml"), (Path("RECORDING"),))


def _path(path: Path) -> str:
    # What begins with a dash would be read as an option.
    text = str(path)
    return f"./{text}" if text.startswith("-") else text


Result = Comparison | Diagnosis | Improvement
LoopDocument = CompareDocument | DiagnosisDocument | ImprovementDocument


@dataclass(frozen=True)
class ResultSummary:
    """What the three kinds of results have in common: steps of a model, each fitted.

    given             files and options of the command line; None: unknown
    held_out_floors   a noise floor a joint, of the held-out recordings; empty without any
    drafted           a guess at what is left was asked for already
    replays           how far the motion of each step's model is off; empty where nobody asked
    """

    result: Result
    given: Invocation | None = None
    held_out_floors: tuple[Floor, ...] = ()
    drafted: bool = False
    replays: tuple[ReplayStep, ...] = ()

    @cached_property
    def document(self) -> LoopDocument:
        """As --json writes it."""
        origin = UNSET if self.given is None or self.given.provenance is None else self.given.provenance
        if isinstance(self.result, Comparison):
            said = reasons.warned(self.result.fit, self.result.joints, self.suspicions)
            return replace(self.result.document(said), provenance=origin)
        follows = {
            "provenance": origin,
            "more_is_left": self.more_is_left,
            "peaks": [PeaksEntry(joint=k, frequencies_hz=f) for k, f in enumerate(self.peaks, 1) if f],
            "commands": self.commands,
            "improved_model": None if self.improved is None else str(self.improved),
        }
        if isinstance(self.result, Diagnosis):
            return diagnosed.document(self.result).as_part_of(DiagnosisDocument, draft=None, **follows)
        floors = self.floor_entries or UNSET
        replay = list(self.replays) or UNSET
        return diagnosed.improved(self.result).as_part_of(
            ImprovementDocument, held_out_floors=floors, replay=replay, **follows
        )

    @cached_property
    def suspicions(self) -> tuple[Suspicion, ...]:
        """What looks wrong with the data."""
        if self.diagnosis is not None:
            return self.diagnosis.searched.suspicions
        return suspicions(self.last.fit, [] if self.given is None else [p.name for p in self.given.recordings])

    @property
    def floor_entries(self) -> list[FloorEntry]:
        """The held-out floors, as documents have them."""
        floors = enumerate(self.held_out_floors, 1)
        return [FloorEntry(joint=k, floor=f.value, floor_source=f.source) for k, f in floors]

    @cached_property
    def steps(self) -> tuple[Step, ...]:
        if not isinstance(self.result, Comparison):
            return self.result.steps
        return (Step.of(self.result.fit, self.result.joints),)

    @property
    def first(self) -> Step:
        return self.steps[0]

    @property
    def last(self) -> Step:
        return self.steps[-1]

    @property
    def diagnosis(self) -> Diagnosis | None:
        """The diagnosis of the model as given."""
        if isinstance(self.result, Improvement):
            return self.result.found
        return self.result if isinstance(self.result, Diagnosis) else None

    @property
    def left(self) -> Diagnosis | None:
        """The diagnosis of the last model."""
        return self.result.left if isinstance(self.result, Improvement) else self.diagnosis

    @property
    def more_is_left(self) -> bool:
        """Whether effects were found, and what they leave is more than noise."""
        if isinstance(self.result, Improvement):
            return self.result.verdict == "effect" and bool(self.result.left.unexplained)
        if self.diagnosis is None or self.diagnosis.verdict != "effect":
            return False
        effects = self.diagnosis.model.library.effects
        named = any(after_effect(self.last, f.joint_index, effects[f.term.effect]) for f in self.findings)
        return named or any(physics(self.last, i) for i in range(len(self.last.joints)))

    @cached_property
    def peaks(self) -> list[list[float]]:
        """Frequencies of the peaks in the spectrum of each joint's last residual, Hz."""
        found = self.last.fit
        motion, left = found.motion, found.residual
        return [spectra.peaks(residual, motion.row_rate(i), motion.cutoff(i)) for i, residual in enumerate(left)]

    @property
    def findings(self) -> tuple[Step, ...]:
        return self.diagnosis.findings if self.diagnosis else ()

    def findings_at(self, joint: int) -> list[Step]:
        """Findings that act on the torque of a joint (0-based), those of the whole arm among them."""
        return [f for f in self.findings if f.term.joint in (None, joint + 1)]

    def called(self, joint: int) -> str:
        """A joint (0-based) as headings and tables call it."""
        return numbered(joint + 1, self.first.joints[joint].name)

    @cached_property
    def joint_order(self) -> list[int]:
        """Joints (0-based) in the order of a page: those with findings, those above their noise floor, the others."""
        joints = range(len(self.first.joints))
        return sorted(joints, key=lambda i: (i not in self._found_at, self.at_floor(i), i))

    def moves(self, joint: int) -> bool:
        """Whether a joint (0-based) has rows that are compared."""
        return len(self.first.joints[joint].t) > 1

    def at_floor(self, joint: int) -> bool:
        """Whether nothing was found at a joint (0-based) alone, and what is left there is noise."""
        unexplained = self.left is not None and joint in self.left.unexplained
        return self.last.joints[joint].at_floor and not unexplained and joint not in self._found_at

    @cached_property
    def _found_at(self) -> set[int]:
        """Joints (0-based) at which a finding sits."""
        model, own = self.first.fit.model, [f.term for f in self.findings if f.term.joint is not None]
        coupled = (t for t in own if model.library.effects[t.effect].scope == "joints")
        return {t.joint - 1 for t in own if t.joint is not None} | {i for t in coupled for i in joints_of(model, t)}

    # --- floors: the better the model, the better they are known, since a wrong one leaves its error in the repeats

    def floor(self, joint: int) -> float:
        """Noise floor of the fitted recordings relative to the torque, as the error is."""
        return relative_floor(self.last.joints[joint])

    def held_out_floor(self, joint: int) -> float | None:
        """The same of the held-out recordings; None where it is not known."""
        held = self.last.held_out
        if held is None or not self.held_out_floors or not held.rms[joint]:
            return None
        return self.held_out_floors[joint].value * held.relative[joint] / held.rms[joint]

    # --- what to type next

    @property
    def invocation(self) -> Invocation:
        return self.given or unknown(self.first.fit.model.name)

    def copying(self) -> list[CommandEntry]:
        """What comes before the first effect is added to an arm of Tendon: a copy of it."""
        named = self.findings and self.invocation.like
        return [_command("makes a model file of yours, to add it to", self.invocation.copy())] if named else []

    def adding(self) -> list[CommandEntry]:
        """One command a finding, in their order."""
        return [_command(f"adds {f.term.effect}{at(f.term)}", self.invocation.add(f.term)) for f in self.findings]

    def separating(self) -> list[CommandEntry]:
        """One command for every finding and rival of it."""
        return [
            _command(
                f"designs the motion that tells {f.term.effect} from {rival.effect}{at(rival)}",
                self.invocation.experiment((f.term, rival)),
            )
            for f in self.findings
            for rival in f.rivals
        ]

    def drafting(self) -> list[CommandEntry]:
        """What helps further where nothing in the library explains what is left."""
        if self.drafted or self.left is None or not self.left.unexplained:
            return []
        return [
            _command("drafts an effect for what is left, as a guess", self.invocation.draft()),
            _command("adds the guess, if it lowers the error", self.invocation.try_draft()),
        ]

    def refitting(self) -> list[CommandEntry]:
        """What is to do once the findings are added."""
        if not self.findings:
            return []
        return [_command("fits the model again and writes its values", self.invocation.identify())]

    @property
    def improved(self) -> Path | None:
        """The file in which every finding is already."""
        return self.invocation.improved if self.findings else None

    @property
    def commands(self) -> list[CommandEntry]:
        """What is still to do, in its order."""
        to_do = [] if self.improved else [*self.copying(), *self.adding(), *self.refitting()]
        return [*to_do, *self.separating(), *self.drafting()]


def _command(what: str, line: str) -> CommandEntry:
    return CommandEntry(what=what, command=line)


def relative_floor(series: JointSeries) -> float:
    """The noise floor relative to the torque, as the error is."""
    return series.floor.value * series.relative / series.rms if series.rms else 0.0

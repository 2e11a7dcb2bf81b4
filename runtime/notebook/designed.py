"""Motions that are designed: the first, the next, and those that separate rivals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from runtime.documents.experiments import FirstMotionDocument
from runtime.documents.recordings import DeterminedParameter, ExperimentDocument
from runtime.experiments import asking, design
from runtime.experiments.first_proposal import FirstProposal, propose_first
from runtime.experiments.options import ExperimentSettings, FirstMotionSettings
from runtime.notebook.arm import LoadedArm, PathOrText
from runtime.notebook.results import MadeResult, several
from runtime.recordings.recording import Recording
from runtime.report import recordings
from runtime.wording import quantity, sentence
from runtime.workspace.moving import MotionBounds, separating, told_by


@dataclass(frozen=True, repr=False)
class ExperimentResult(MadeResult[ExperimentDocument]):
    """A motion that separates effects, or why there is none."""

    proposal: design.Proposal
    arm: LoadedArm

    _sections = staticmethod(recordings.experiment)

    @staticmethod
    def _in_short(document: ExperimentDocument) -> list[str]:
        return [sentence(document.reason)]

    @property
    def separated(self) -> bool:
        """Whether the diagnosis tells the effects apart on this motion, in simulation."""
        return self.made.separated

    @property
    def reason(self) -> str:
        """The answer in one sentence."""
        return self.made.reason

    @property
    def motion(self) -> NDArray[np.float64]:
        """(N, n) positions at 1 kHz, rad or m, for your arm or for `simulate(motion=...)`."""
        return self.proposal.motion.T

    def save(self, path: PathOrText) -> None:
        """Write the motion as CSV. Raises OSError."""
        design.write_motion(Path(path), self.arm.model, self.proposal.motion)


@dataclass(frozen=True, repr=False)
class FirstMotionResult(MadeResult[FirstMotionDocument]):
    """The motion that tells most of everything unknown; what is not checked along it is in `.unchecked`."""

    proposal: FirstProposal
    arm: LoadedArm

    _sections = staticmethod(recordings.first_motion)

    @staticmethod
    def _in_short(document: FirstMotionDocument) -> list[str]:
        told = sum(p.told == "well" for p in document.parameters)
        return [
            f"a motion of {quantity(document.seconds, 's', 3)} that tells {told} of {len(document.parameters)} "
            "parameters well",
            *recordings.not_checked(document.unchecked),
        ]

    @property
    def parameters(self) -> list[DeterminedParameter]:
        """Predicted: `.name`, `.told` ("well", "hardly", "together", "no"), `.interval`, `.unit`."""
        return self.made.parameters

    @property
    def unchecked(self) -> list[str]:
        """What nothing keeps the arm from, a sentence each."""
        return self.made.unchecked

    @property
    def motion(self) -> NDArray[np.float64]:
        """(N, n) positions at 1 kHz, rad or m, for your arm or for `simulate(motion=...)`."""
        return self.proposal.first.path.T

    @property
    def held_out(self) -> NDArray[np.float64]:
        """(N, n) another motion, for validation, half as long."""
        assert self.proposal.check is not None
        return self.proposal.check.path.T

    def save(self, path: PathOrText, held_out: PathOrText | None = None) -> None:
        """Write the motion as CSV, and the one for validation. Raises OSError."""
        notes = recordings.motion_notes(self.made)
        design.write_motion(Path(path), self.arm.model, self.motion.T, notes)
        if held_out is not None:
            design.write_motion(Path(held_out), self.arm.model, self.held_out.T, notes)


def experiment(
    arm: LoadedArm,
    between: str | Sequence[str] = (),
    seed: int = ExperimentSettings.seed,
    noise: float = ExperimentSettings.noise,
    joints: int | str | Sequence[int | str] | None = None,
    ranges: Mapping[int | str, tuple[float, float]] | None = None,
    given: Recording | Sequence[Recording] = (),
    start: ArrayLike | None = None,
    seconds: float = FirstMotionSettings.seconds,
    speed: float = FirstMotionSettings.speed,
    tip_speed: float = FirstMotionSettings.tip_speed,
    speeding_up: float = FirstMotionSettings.speeding_up,
    floor: float | None = None,
    scene: PathOrText | None = None,
) -> ExperimentResult | FirstMotionResult:
    """Design the motion that tells most of everything unknown, or with `between` one that separates rival effects.

    between   "linear_spring@1", "gravity", …, with values if you like; a single one is separated from the model
    noise     of the torque, as a part of its rms
    joints    that move, by number (from 1) or name; None: all
    ranges    narrower ranges of joints, rad or m: {2: (-1.0, 0.5)} or {"elbow": (-1.0, 0.5)}
    given     recordings at hand: the motion tells what these leave open
    start     (n,) rad or m, the pose before and after; None: the middle of the ranges
    seconds   about the length; speed: part of the joints' largest; tip_speed in m/s; speeding_up: s, to that speed
    floor     m, height above the base's origin; scene: a file with floor, boxes and tool
    Raises ValueError where nothing is safe.
    """
    settings, chosen = ExperimentSettings(seed, noise), FirstMotionSettings(seconds, speed, tip_speed, speeding_up)
    bounds = MotionBounds(
        start=None if start is None else ",".join(repr(float(x)) for x in np.ravel(np.asarray(start))),
        joints=None if joints is None else ",".join(map(str, several(joints))),
        ranges=[f"{joint}={low}:{high}" for joint, (low, high) in (ranges or {}).items()],
        floor=floor,
        scene=None if scene is None else Path(scene),
    )
    if texts := several(between):
        rivals = asking.parse_rivals(",".join(texts), arm.model)
        proposal = separating(bounds.arm(arm.source, rivals), rivals, settings, chosen, lambda _: None)
        return ExperimentResult(proposal.document().as_part_of(ExperimentDocument, out=None), proposal, arm)
    at_hand, source = None, arm.source
    if data := [given] if isinstance(given, Recording) else list(given):
        source, at_hand = told_by(source, data)
    found = propose_first(bounds.arm(source, at_hand=at_hand), settings, chosen, check=True)
    return FirstMotionResult(found.document, found, arm)

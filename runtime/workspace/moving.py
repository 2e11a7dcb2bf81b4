"""An arm in its surroundings, and what recordings of it leave open: what a search for a motion begins with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from runtime.diagnosis.credibility import judged
from runtime.diagnosis.stages import diagnose
from runtime.experiments.asking import parse_joints, parse_pose, parse_ranges
from runtime.experiments.clearance import Clearance
from runtime.experiments.design import Proposal, Tell, propose
from runtime.experiments.first_proposal import ArmToMove, AtHand, ReadyArm
from runtime.experiments.options import ExperimentSettings, FirstMotionSettings
from runtime.experiments.scene import Scene
from runtime.experiments.solids import MeshClearance
from runtime.recordings.recording import Recording
from runtime.report import diagnosed
from runtime.simulation.simulate import Hidden
from runtime.workspace.source import Source
from symbolic.model_file.exchange.shapes import collision_shapes


@dataclass(frozen=True)
class MotionBounds:
    """What a motion keeps to, as it is typed. start: Q1,Q2,...; joints: numbers or names; ranges: JOINT=LOW:HIGH."""

    start: str | None = None
    joints: str | None = None
    ranges: Sequence[str] = ()
    floor: float | None = None
    boxes: Sequence[str] = ()
    scene: Path | None = None
    shapes: Path | None = None

    def arm(self, source: Source, rivals: Sequence[Hidden] = (), at_hand: AtHand | None = None) -> ArmToMove:
        """The arm within them. Raises ExperimentError, ModelError."""
        model, (likely, assumed) = source.compiled.model(), source.compiled.with_likely_numbers()
        scene = Scene.of(self.floor, self.boxes, self.scene)
        room = Clearance.of(likely.arm, scene)
        unchecked, shapes = room.unchecked, None
        if self.shapes is not None:
            shapes = MeshClearance.of(likely.arm, scene, *collision_shapes(self.shapes, likely.arm))
            unchecked = (*unchecked, *shapes.lacking, *shapes.unchecked)
        return ArmToMove(
            model,
            likely.model(),
            likely.arm,
            assumed,
            room,
            tuple(dict.fromkeys(unchecked)),
            start=None if self.start is None else parse_pose(self.start),
            moving=None if self.joints is None else parse_joints(self.joints, model, rivals),
            ranges=parse_ranges(self.ranges, model),
            shapes=shapes,
            given=at_hand,
        )


def told_by(source: Source, recordings: Sequence[Recording]) -> tuple[Source, AtHand]:
    """The model file with what these recordings tell, and what they leave open."""
    found = diagnose(source.compiled.model(), recordings)
    fit = found.found.steps[0].fit
    believed = judged(fit, recordings)
    if believed.verdict == "fitted":
        source = source.with_text(source.edits.set(diagnosed.judged(believed)).text)
    open_one = next((finding for finding in found.findings if finding.rivals), None)
    rivals = () if open_one is None else (open_one.term, *open_one.rivals)
    return source, AtHand(fit, recordings, tuple(Hidden(term, {}) for term in rivals))


def separating(
    to_move: ArmToMove, rivals: Sequence[Hidden], settings: ExperimentSettings, chosen: FirstMotionSettings, say: Tell
) -> Proposal:
    """The motion that separates rivals within what the arm keeps to."""
    ready = ReadyArm.of(to_move, settings, chosen)
    return propose(
        to_move.model, rivals, settings, say, ready.moving, ready.ranges, to_move.likely, ready.limits.is_free
    )

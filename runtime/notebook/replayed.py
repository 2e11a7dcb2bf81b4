"""Recorded torques that drive the model, and the result."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from runtime.documents.replays import ReplayDocument, ReplayedJoint, ReplayStep
from runtime.identification import identify as identification
from runtime.notebook.arm import LoadedArm, PathOrText
from runtime.notebook.results import MadeResult
from runtime.notebook.verbs import Recordings, read_both
from runtime.replay.replay import Replay
from runtime.report import replays
from runtime.report.page.replay_page import replay_page


@dataclass(frozen=True, repr=False)
class ReplayResult(MadeResult[ReplayDocument]):
    """How far the motion of a model is off."""

    replay: Replay

    _sections = staticmethod(replays.sections)

    @staticmethod
    def _in_short(document: ReplayDocument) -> list[str]:
        return [replays.headline(document.steps)]

    @property
    def joints(self) -> list[ReplayedJoint]:
        """The errors of each joint's motion: `.open_loop` by windows' length, `.closed_loop`, `.agrees`, `.reason`."""
        return self.document.steps[0].joints

    def report(self, directory: PathOrText) -> Path:
        """Write the HTML page, with the arm in motion, into a directory; its path. Raises OSError."""
        return replay_page([self.replay], self.document).write(Path(directory))


def replay(arm: LoadedArm, recordings: Recordings, fit: Recordings = ()) -> ReplayResult:
    """Let the recorded torque or command drive the model: how far does its motion come from the recorded one?

    fit   recordings to which all parameters are fitted first; without any, the values of the model file count
    """
    fitted, held = read_both(arm, fit or recordings, recordings if fit else ())
    if fit:
        found = Replay.of_fit(identification.identify(arm.model, fitted), held)
    else:
        found = Replay.of_file(arm.model, fitted)
    steps = [ReplayStep(added=None, joints=found.joints)]
    return ReplayResult(ReplayDocument(arm=arm.model.name, fitted=bool(fit), steps=steps), found)

"""The page of a replay: the arm as recorded and as the model moves, and every joint's positions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from runtime.arrays import Array
from runtime.documents.parts import given
from runtime.documents.replays import ReplayDocument
from runtime.plain_json import plain
from runtime.replay.elsewhere import MujocoReplay
from runtime.replay.replay import Replay
from runtime.report import origin, replays
from runtime.report.page.arm_motion import ArmMotion, Course, frames, picture
from runtime.report.page.html import ReportPage, add_figures, part
from runtime.report.page.moving import LONGEST
from runtime.report.page.page_figures import drawn
from runtime.report.page.reports import origin_group
from runtime.report.plots import motion_plots
from runtime.report.sections import Group, Paragraph, Plots, texts
from runtime.wording import numbered, sentence


@dataclass(frozen=True)
class ReplayedSeconds:
    """Some seconds of a recording: times t (F,) s, positions recorded (n, F), and those of every model (n, F).

    elsewhere   those of every model in MuJoCo; empty where nobody asked
    """

    t: Array
    recorded: Array
    models: tuple[Array, ...]
    elsewhere: tuple[Array, ...]
    closed: bool
    restart: float

    @property
    def how(self) -> str:
        """What drives the model, in words."""
        return "in closed loop" if self.closed else f"in open loop, anew from the recording every {self.restart:g} s"


def replay_page(
    found: Sequence[Replay], document: ReplayDocument, elsewhere: Sequence[MujocoReplay] = ()
) -> ReportPage:
    """The page of a replay of one model or two, and elsewhere, in MuJoCo; document: what --json gives."""
    model, seconds = found[-1].model, replayed_seconds(found, elsewhere)
    own = document.steps[: len(found)]
    drawings, made = {}, []
    groups = [Group("Errors", (*replays.errors(document.steps), *texts(replays.translation(document.steps))), "errors")]
    if seconds is not None:
        drawings["moving"] = part("arm_motion.html.j2", "arm_motion", moving_arm(found, seconds))
        groups.insert(0, Group("The arm in motion", (Plots(("moving",)),), "motion"))
        for i, joint in enumerate(model.joints):
            if own[-1].joints[i].agrees is not None:
                caption = f"Joint {numbered(i + 1, joint.name)}: position, and how far the model is off, {seconds.how}."
                models, others = (tuple(q[i] for q in drawn) for drawn in (seconds.models, seconds.elsewhere))
                lines = motion_plots.ReplayedJointLines(
                    seconds.t, seconds.recorded[i], models, others, joint.position_unit
                )
                made.append(drawn(motion_plots.replayed_joint(lines), f"replayed{i + 1}", caption))
        legend = "Blue: the model" if len(found) == 1 else "Orange: the model before, blue: the model after"
        legend += "; dashed, where it is off: the same in MuJoCo" if elsewhere else ""
        plots = Plots(add_figures(drawings, made, "replayed"))
        groups.append(Group("Joint by joint", (Paragraph(f"{legend}; black: recorded.", "note"), plots), "joints"))
    agreement = tuple(texts(map(sentence, replays.agreement(own[-1]))))
    groups.append(Group(replays.AGAINST, agreement, "agreement"))
    provenance = given(document.provenance)
    groups += origin_group(provenance)
    return ReportPage(
        title=f"{model.name}: replayed",
        model=model.name,
        kind="clean",
        tag="replay",
        headline=sentence(replays.headline(own)),
        short=[],
        groups=groups,
        drawings=drawings,
        made="" if provenance is None else origin.made(provenance),
        document=plain(document),
    )


def replayed_seconds(found: Sequence[Replay], elsewhere: Sequence[MujocoReplay] = ()) -> ReplayedSeconds | None:
    """The seconds in which the first model is off most; in closed loop where the joints have controllers, but in open
    loop beside MuJoCo, which plays no others."""
    every = (*found, *elsewhere)
    closed = not elsewhere and found[0].closed_loop is not None
    played = [one.closed_loop if closed else one.longest for one in every]
    there = [each for each in played if each is not None]
    if len(there) < len(every):
        return None
    first = there[0]
    worst = int(np.nanargmax(np.nanmean((first.played - first.recorded) ** 2, axis=(1, 2))))
    track, begin = first.windows.starts[worst]
    row = [k for k, (other, start) in enumerate(first.windows.starts) if other == track and start >= begin]
    most = max(1, round(LONGEST / (first.windows.length * first.dt)))
    own = row[:most]
    t = found[0].tracks[track].t[begin : begin + len(own) * first.windows.length]
    at = frames(len(t))

    def joined(x: Array) -> Array:
        # The first sample of a window is the recorded state.
        whole: Array = np.concatenate([x[k, :-1] for k in own]).T[:, at]
        return whole

    drawn = [np.nan_to_num(joined(each.played)) for each in there]
    models, others = tuple(drawn[: len(found)]), tuple(drawn[len(found) :])
    return ReplayedSeconds(t[at], joined(first.recorded), models, others, closed, first.windows.length * first.dt)


def moving_arm(found: Sequence[Replay], seconds: ReplayedSeconds) -> dict[str, Any]:
    """Variables of the template for the arm as recorded and as the last model moves."""
    said = (
        f"The arm as recorded, dashed, and as the model moves, {seconds.how}: the seconds from {seconds.t[0]:.1f} s "
        "on, in which the model is off most."
    )
    return picture(_moving(found, seconds), said)


def _moving(found: Sequence[Replay], seconds: ReplayedSeconds) -> ArmMotion:
    model = found[-1].model
    courses = (Course("recorded", seconds.recorded), Course("replayed", seconds.models[-1]))
    return ArmMotion(model=model, t=seconds.t, courses=courses)

"""Sections of replay: the errors of the model's motion, before and after."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf

from runtime.documents.fits import IdentifyDocument
from runtime.documents.parts import given
from runtime.documents.replays import (
    MotionErrorEntry,
    OutputErrorEntry,
    ReplayDocument,
    ReplayedJoint,
    ReplayStep,
)
from runtime.identification.estimate import Estimate
from runtime.report import fits
from runtime.report.fits import place
from runtime.report.sections import Group, Section, TableColumn, TableSection, cut, table, texts, words
from runtime.wording import number, percent, quantity, unit

_CLOSED = "closed loop"
NO_CLOSED_LOOP = "No closed loop: the model states neither gains of a joint's controller nor a drive's law."
AGAINST = "Against the torque's error"


def sections(document: ReplayDocument) -> list[Section]:
    """As the terminal prints it."""
    steps = [step for step in document.steps if step.player == "tendon"]
    return [
        *texts([f"{document.arm}: {headline(steps)}", ""]),
        *errors(document.steps),
        *texts(translation(document.steps)),
        Group(AGAINST, tuple(texts(agreement(steps[-1])))),
    ]


def translation(steps: Sequence[ReplayStep]) -> list[str]:
    """What is lost in MuJoCo: how far its motion is from that of Tendon's equations, in the longest windows."""
    lines = []
    for step in (s for s in steps if s.player == "mujoco"):
        names = {j.joint: j.name for j in step.joints}
        said = []
        for joint in step.joints:
            error = _longest(joint)
            apart = None if error is None else given(error.apart)
            if error is not None and apart is not None:
                part = f" ({percent(apart * error.share / error.rms)})" if error.share and error.rms else ""
                said.append(f"joint {place(joint.joint, names)} {quantity(apart, joint.unit, 2)}{part}")
        lines.append(f"{called(step)}, the motion is off that of Tendon's equations: {'; '.join(said)}.")
    return lines


def headline(steps: Sequence[ReplayStep]) -> str:
    """The worst joint's error in the longest window, before and after."""
    errors = {j.joint: e for j in steps[-1].joints if (e := _longest(j)) is not None}
    if not errors:
        return "no joint moves in a stretch that is long enough for a window"
    worst = max(errors, key=lambda k: inf if (share := errors[k].share) is None else share)
    entries = [step.joints[worst - 1] for step in steps]
    found = [e for entry in entries if (e := _longest(entry)) is not None]
    where = f"joint {worst}" if len(steps[-1].joints) > 1 else "the joint"
    after = " → ".join(_error(e, entries[-1].unit) for e in dict.fromkeys(found))
    when = f"after {number(found[-1].seconds, 3)} s in open loop"
    return f"{when}, error of {where} (rms, and as a share of its motion): {after}"


def errors(steps: Sequence[ReplayStep]) -> list[Section]:
    """A row a joint and model, a column a length of windows; nothing of no steps."""
    if not steps:
        return []
    seconds = list(dict.fromkeys(e.seconds for step in steps for j in step.joints for e in j.open_loop))
    closed = any(j.closed_loop is not None for step in steps for j in step.joints)
    figures = [*(f"{number(s, 3)} s" for s in seconds), *[_CLOSED] * closed]
    names = {j.joint: j.name for j in steps[-1].joints}
    rows = []
    for at in names:
        for step in steps:
            joint = step.joints[at - 1]
            if joint.agrees is None:
                continue
            by_length = {e.seconds: e for e in joint.open_loop}
            cells = [_cell(by_length.get(s), joint.unit) for s in seconds]
            cells += [_cell(joint.closed_loop, joint.unit)] * closed
            rows.append([place(at, names), *([called(step)] if len(steps) > 1 else []), *cells])
    if not rows:
        return []
    model = [TableColumn("model", "estimate")] if len(steps) > 1 else []
    made = [_titled(table([words("joint"), *model, *figures], rows))]
    return made if closed else [*made, *texts([NO_CLOSED_LOOP])]


def _titled(made: TableSection) -> Section:
    return Group("Error of the motion, rms, and as a share of the motion in the window", (made,))


def called(step: ReplayStep) -> str:
    """A step as tables call it."""
    name = "as given" if step.added is None else f"with {step.added}" if "@" in step.added else step.added
    return name if step.player == "tendon" else f"{name}, in MuJoCo"


def agreement(step: ReplayStep) -> list[str]:
    """A line a joint: what the torque's error promises of the motion, and what has other causes."""
    names = {j.joint: j.name for j in step.joints}
    lines = []
    for joint in step.joints:
        error = _longest(joint)
        said = f"joint {place(joint.joint, names)}: {joint.reason}"
        if error is not None and None not in (parts := (error.promised, error.rest, error.rms)):
            promised, rest, both = (quantity(x, joint.unit, 2) for x in parts if x is not None)
            said += f" (after {number(error.seconds, 3)} s the torque's error makes {promised}, all else {rest}, "
            said += f"together {both})"
        lines.append(f"{said}.")
    return lines


def _longest(joint: ReplayedJoint) -> MotionErrorEntry | None:
    return joint.open_loop[-1] if joint.open_loop and joint.agrees is not None else None


def _cell(error: MotionErrorEntry | None, unit: str) -> str:
    return "–" if error is None else _error(error, unit)


def _error(error: MotionErrorEntry, unit: str) -> str:
    if error.rms is None or error.share is None:
        return "runs away"
    return f"{quantity(error.rms, unit, 2)}, {percent(error.share)}"


def identification(document: IdentifyDocument) -> list[Section]:
    """A fit, and what the simulated motion says of it."""
    found = given(document.output_error)
    return [*fits.identification(document), *(refined(found) if found is not None else [])]


def refined(found: OutputErrorEntry) -> list[Section]:
    """What output error changed: parameters, and the error of each joint's motion."""
    first = found.motions[0].after.seconds if found.motions else 0.0
    rows = [
        (
            place(p.joint, {}),
            p.name,
            number(p.before),
            fits.estimate(Estimate(p.after, p.interval, p.unit)),
            unit(p.unit) or "1",
        )
        for p in found.parameters
    ]
    lines = [
        f"joint {m.joint}: {_error(m.before, m.unit)} before, {_error(m.after, m.unit)} after." for m in found.motions
    ]
    changed = "Refined by the motion" if found.better else "Not refined: no parameters lower the error of the motion"
    title = f"{changed}, in windows of {number(first, 3)} s; shift of the torque {number(found.skew, 2)} samples"
    heads = (
        words("joint"),
        words("parameter"),
        "by the torque",
        TableColumn("by the motion", "estimate"),
        words("unit"),
    )
    made = table(heads, rows)
    return [Group(title, (*texts(cut(found.search)), made, *texts(lines)))]

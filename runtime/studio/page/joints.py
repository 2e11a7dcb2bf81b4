"""The joints: the arm in motion, the error of each joint, and the signals of the one that is shown."""

from __future__ import annotations

import json
from functools import partial

from runtime.motion.settings import MORE_THAN_NOISE
from runtime.studio.history import JointError
from runtime.studio.page.view import PageView, arm_in_motion, button, put, signals
from runtime.wording import number, percent


def motion(view: PageView) -> None:
    """The arm in motion. A click on a joint shows that joint."""
    arm = view.overview.arm
    put("h2", "The arm in motion")
    if arm is None:
        put("p", "There is no picture: the rigid-body torque comes from your own model.", "of")
        return
    arm_in_motion(arm).on("joint", lambda e: view.show_joint(int(e.args["detail"]) + 1), ["detail"])


def errors(view: PageView) -> None:
    """The error of every joint, of the model as given and of the current step, beside its noise floor."""
    here, given = view.step, view.given
    put("h2", "Error against the noise floor")
    every = (*given.joints, *here.joints)
    ends = [end for j in every for end in (j.relative, j.relative_floor, j.held, j.held_floor) if end]
    with put("div", classes="bars"):
        for before, after in zip(given.joints, here.joints, strict=True):
            _joint(view, before if here is not given else None, after, max(ends, default=1.0))
    notes = ["Vertical line: noise floor, the error of a perfect model."]
    if any(j.held is not None for j in here.joints):
        notes.append("Thin bar: error on the held-out recording.")
    if here is not given:
        notes.append("Outline: the model as given.")
    put("p", " ".join(notes), "of")


def _joint(view: PageView, before: JointError | None, after: JointError, longest: float) -> None:
    """Bars of a joint; `before`: with the model as given, if that is another one."""
    chosen = view.joint.joint == after.joint
    pressed = put("button", classes="bar-joint", type="button", aria_pressed=json.dumps(chosen), data_joint=after.joint)
    with pressed.on("click", lambda _: view.show_joint(after.joint)):
        with put("span", classes="bar-head"):
            unexplained, said = _is_unexplained(view, after), _against_floor(after.floors)[1]
            _spot(view, after)
            put("b", f"Joint {after.called}")
            put("span", "the residual is more than sensor noise" if unexplained else said, "of")
        old = (None, None) if before is None else (before.relative, before.held)
        good = after.floors is not None and after.floors < MORE_THAN_NOISE and not unexplained
        _bar("fitted", old[0], after.relative, floor=after.relative_floor, longest=longest, good=good)
        if after.held is not None:
            _bar("held out", old[1], after.held, floor=after.held_floor, longest=longest)


def navigation(view: PageView) -> None:
    """What stays in view: the joints, and links to the parts of the page."""
    joints = view.step.joints
    if len(joints) > 1:
        with put("div", classes="joints", role="group", aria_label="Joints"):
            for joint in joints:
                chosen = json.dumps(view.joint.joint == joint.joint)
                pressed = put("button", type="button", aria_pressed=chosen, data_go=joint.joint, title=joint.called)
                with pressed.on("click", partial(lambda number, _: view.show_joint(number), joint.joint)):
                    _spot(view, joint)
                    put("span", "Joint", "word")
                    put("b", str(joint.joint))
                    put("span", percent(joint.relative), "of")
    parts = {"verdict": "Verdict", "joint": f"Joint {view.joint.joint}", "findings": "Findings", "try": "Add an effect"}
    if view.verdict is None or not view.verdict.findings:
        parts.pop("findings")
    with put("div", classes="links"):
        for name, text in {**parts, "ask": "Ask the model", "change": "Model file", "recordings": "Recordings"}.items():
            put("a", text, href=f"#{name}")


def _spot(view: PageView, joint: JointError) -> None:
    level = 2 if _is_unexplained(view, joint) else _against_floor(joint.floors)[0]
    put("span", classes="spot", data_level=level)


def _is_unexplained(view: PageView, joint: JointError) -> bool:
    return view.verdict is not None and joint.joint in view.verdict.unexplained


def _against_floor(floors: float | None) -> tuple[int, str]:
    """Level and words for an error in noise floors; None: there is no floor."""
    if floors is None:
        return 0, "never moves"
    level = 1 + (floors > MORE_THAN_NOISE) + (floors > 2 * MORE_THAN_NOISE)
    return level, "at its noise floor" if floors < MORE_THAN_NOISE else f"{number(floors, 2)} × its noise floor"


def _bar(
    name: str, before: float | None, after: float, *, floor: float | None, longest: float, good: bool = False
) -> None:
    """An error, in parts of the longest bar; `before`: from where it falls; good: nothing is missing."""
    said = change(before, after)
    with put("span", classes=f"bar-row {name.replace(' ', '-')}"):
        put("span", name, "bar-name")
        with put("span", classes="bar-track", role="img", aria_label=f"error {name} {said}"):
            width = f"width:{100 * after / longest:.2f}%"
            if before is None:
                put("span", classes="bar clean" if good else "bar", style=width)
            else:
                put("span", classes="bar ghost", style=f"width:{100 * before / longest:.2f}%")
                put("span", classes="bar bar-now", style=f"{width};--from:{100 * before / longest:.2f}%")
            if floor is not None:
                put("span", classes="bar-floor", style=f"left:{100 * floor / longest:.2f}%")
        put("span", said, "bar-value")


def change(before: float | None, after: float) -> str:
    """An error, and from where it came unless that reads the same."""
    old, new = "" if before is None else percent(before), percent(after)
    return new if old in ("", new) else f"{old} → {new}"


def joint(view: PageView) -> None:
    """Torque, prediction and residual of the chosen joint over time, and the residual over every signal."""
    shown = view.joint
    put("h2", f"Joint {shown.called}")
    if shown.signals is None:
        put("p", "This joint never moves in these recordings; there is nothing to compare.", "warning")
        return
    follows = ", ".join(f"{name} ({percent(share, 0)})" for name, share in shown.structure)
    if shown.at_floor:
        put("p", "The residual of this joint is at its noise floor.", "of")
    else:
        put("p", f"The residual follows {follows or 'none of the recorded signals'}.", "of")
    beside = view.held_out and shown.held_signals is not None
    if shown.held_signals is not None:
        with put("div", classes="acts"):
            text = "Hide the held-out recording" if view.held_out else "Show the held-out recording"
            button(text, lambda: view.set(held_out=not view.held_out), data_do="held-out")
    sets = {"Fitted": shown.signals, "Held out": shown.held_signals if beside else None}
    with put("div", classes="beside" if beside else ""):
        for title, name in sets.items():
            if name is not None:
                with put("div"):
                    if beside:
                        put("h3", title)
                    # Another mark makes the browser load the signals again, after a diagnosis for instance.
                    signals(name, data_mark=f"{view.step.number}-{view.step.verdict}")

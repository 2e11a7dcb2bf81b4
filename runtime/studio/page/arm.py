"""The arm, moving as it was recorded, and its joints with what is left of the torque of each."""

from __future__ import annotations

import json

from markupsafe import Markup
from nicegui.element import Element

from runtime.report.page.filling import embedded, part
from runtime.studio.history import JointError, SessionStep
from runtime.studio.page.parts import markup, put
from runtime.studio.page.view import PageView
from runtime.studio.shown import Row
from runtime.wording import MORE_THAN_NOISE, number, percent


def picture(view: PageView) -> None:
    """The arm in motion; a click on a joint looks into it."""
    arm = view.shown["arm"]
    put("h2", "The arm in motion")
    if arm is None:
        put("p", "The rigid arm is that of your own model: the model file does not say how it looks.", "of")
        return
    moving(arm).on("joint", lambda e: view.set(chosen=int(e.args["detail"]) + 1), ["detail"])


def moving(arm: Row) -> Element:
    """The picture of an arm in motion; it says "joint" with its number, from 0, where one is pressed."""
    picture = {**arm, "data": Markup(embedded(arm["data"]))}
    return markup(part("arm_motion.html.j2", "arm_motion", picture), "arm-picture")


def joints(view: PageView) -> None:
    """Of every joint its error, as given and as it is, against its noise floor; a press looks into it."""
    here, first = view.here, view.studio.history.steps[0]
    assert here is not None
    put("h2", "Error against the noise floor")
    longest = max([max(_ends(j)) for step in (first, here) for j in step.joints] or [1.0]) or 1.0
    with put("div", classes="bars"):
        for before, after in zip(first.joints, here.joints, strict=True):
            _joint(view, before, after, here, longest)
    held = any(j.held is not None for j in here.joints)
    put(
        "p",
        "The mark is the noise floor: a perfect model would leave that."
        + (" The thinner bar is the recording that was held out and never fitted." if held else "")
        + ("" if here.number == 0 else " Outlined: the model as given."),
        "of",
    )


def _ends(joint: JointError) -> list[float]:
    return [joint.relative, joint.relative_floor, joint.held or 0.0, joint.held_floor or 0.0]


def level(floors: float | None) -> str:
    """As the arm's picture marks a joint."""
    if floors is None:
        return "0"
    return str(1 + (floors > MORE_THAN_NOISE) + (floors > 2 * MORE_THAN_NOISE))


def _joint(view: PageView, before: JointError, after: JointError, here: SessionStep, longest: float) -> None:
    chosen = view.joint["joint"] == after.joint
    pressed = put("button", classes="bar-joint", type="button", aria_pressed=json.dumps(chosen), data_joint=after.joint)
    with pressed.on("click", lambda _: view.set(chosen=after.joint)):
        with put("span", classes="bar-head"):
            unexplained = view.verdict is not None and after.joint in [
                row["joint"] for row in view.verdict["left_over"]
            ]
            put("span", classes="spot", data_level="2" if unexplained else level(after.floors))
            put("b", f"Joint {after.called}")
            put("span", "what is left is no noise of the instruments" if unexplained else _floors(after), "of")
        changed = here.number > 0
        _bar("fitted", before.relative if changed else None, after.relative, after.relative_floor, longest)
        if after.held is not None:
            _bar("held out", before.held if changed else None, after.held, after.held_floor, longest)


def _floors(joint: JointError) -> str:
    if joint.floors is None:
        return "never moves"
    return "at its noise floor" if joint.floors < MORE_THAN_NOISE else f"{number(joint.floors, 2)} × its noise floor"


def _bar(name: str, before: float | None, after: float, floor: float | None, longest: float) -> None:
    """One error; `before` is where it falls from."""
    said = percent(after) if before is None else f"{percent(before)} → {percent(after)}"
    with put("span", classes=f"bar-row {name.replace(' ', '-')}"):
        put("span", name, "bar-name")
        with put("span", classes="bar-track", role="img", aria_label=f"error {name} {said}"):
            start = after if before is None else before
            if before is not None:
                put("span", classes="bar ghost", style=f"width:{100 * before / longest:.2f}%")
            style = f"width:{100 * after / longest:.2f}%;--from:{100 * start / longest:.2f}%"
            put("span", classes="bar bar-now" if before is not None else "bar", style=style)
            if floor is not None:
                put("span", classes="bar-floor", style=f"left:{100 * floor / longest:.2f}%")
        put("span", said, "bar-value")

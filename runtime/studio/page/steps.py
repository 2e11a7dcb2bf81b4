"""The history: every step with its error, undone, gone to and compared; what is in the model, and its share."""

from __future__ import annotations

import difflib
import json
from functools import partial

from runtime.studio.history import PlacedEffect, SessionStep
from runtime.studio.page.parts import button, folded, put
from runtime.studio.page.verdict import TAGS
from runtime.studio.page.view import PageView
from runtime.wording import percent


def history(view: PageView) -> None:
    """All steps, and the way back and forth."""
    studio, busy = view.studio, view.busy
    steps, here = studio.history.steps, view.here
    put("h2", "Steps")
    with put("div", classes="acts"):
        button("Undo", lambda: view.act(studio.undo), disabled=busy or not studio.history.can_undo, data_do="undo")
        button("Redo", lambda: view.act(studio.redo), disabled=busy or not studio.history.can_redo, data_do="redo")
    with put("ol", classes="steps"):
        for step in steps:
            _step(view, step, step is here)


def _step(view: PageView, step: SessionStep, current: bool) -> None:
    joint = step.joints[view.joint["joint"] - 1]
    with put("li"):
        pressed = put(
            "button", classes="step", type="button", aria_current="step" if current else None, data_step=step.number
        )
        pressed.props["disabled"] = view.busy
        with pressed.on("click", lambda _: view.act(lambda: view.studio.go_to(step.number))):
            put("span", str(step.number), "step-number")
            put("span", step.title, "step-title")
            errors = percent(joint.relative) + ("" if joint.held is None else f", held out {percent(joint.held)}")
            put("span", errors, "step-error")
            if step.verdict is not None:
                put("span", TAGS.get(step.verdict, step.verdict), f"tag {step.verdict}")


def model(view: PageView) -> None:
    """The effects in the model with their values; each can be left out, to see its share."""
    joint, several = view.joint, len(view.shown["joints"]) > 1
    active = [row for row in view.shown["active"] if row["joint"] in (None, joint["joint"])]
    where = f", joint {joint['called']} and the whole arm" if several else ""
    put("h2", f"Effects in the model{where}")
    if not active:
        put("p", "None: rigid bodies alone.", "of")
    with put("ul", classes="effects"):
        for row in active:
            effect = PlacedEffect(row["effect"], row["joint"])
            with put("li"):
                put("b", str(effect))
                values = "; ".join(f"{p['name']} {p['value']} {p['unit']}".strip() for p in row["parameters"])
                put("span", values, "of")
                button(
                    "Leave out",
                    partial(view.act, view.studio.without, effect),
                    disabled=view.busy,
                    title=f"Fit without {effect}, to see its share",
                    data_do="without",
                )


def change(view: PageView) -> None:
    """What the steps change in the model file, and the files to take away."""
    studio, here = view.studio, view.here
    assert here is not None
    put("h2", "The model file")
    with put("div", classes="acts"):
        for what, text in (("model", "Download the model file"), ("commands", "Download the commands")):
            put("a", text, "download", href=f"/download/{what}?step={here.number}", download="")
        if studio.report(here.number) is not None:
            put("a", "Download the report", "download", href=f"/download/report?step={here.number}", download="")
    others = [("", "the file as it was given")]
    others += [(str(s.number), f"step {s.number}: {s.title}") for s in studio.history.steps if s is not here]
    against = view.against if view.against is not None and view.against != here.number else None
    view.controls.choice(
        "against",
        "Compare this step with",
        others,
        "" if against is None else str(against),
        lambda value: view.set(against=int(value) if value else None),
    )
    if against is not None:
        _errors(studio.history.step(against), here)
    _difference(_text(view, against), studio.model_text(here.number))
    with folded("The commands that do the same in a terminal", open_=True):
        put("pre", "\n".join(studio.commands(here.number)), data_commands="")


def _text(view: PageView, number: int | None) -> str:
    return view.studio.given_text() if number is None else view.studio.model_text(number)


def _errors(other: SessionStep, here: SessionStep) -> None:
    """The errors of two steps beside each other."""
    heads = (
        "joint",
        f"step {other.number}",
        f"step {here.number}",
        f"step {other.number}, held out",
        f"step {here.number}, held out",
    )
    with put("div", classes="scroll"), put("table", classes="stack"):
        with put("thead"), put("tr"):
            for head in heads if here.joints and here.joints[0].held is not None else heads[:3]:
                put("th", head, scope="col")
        with put("tbody"):
            for before, after in zip(other.joints, here.joints, strict=True):
                with put("tr"):
                    put("th", after.called, scope="row")
                    for head, value in zip(
                        heads[1:], (before.relative, after.relative, before.held, after.held), strict=True
                    ):
                        if value is not None:
                            put("td", percent(value), "n", data_is=head)


def _difference(before: str, after: str) -> None:
    """Lines that went and came, with a few around them."""
    lines = list(difflib.unified_diff(before.splitlines(), after.splitlines(), lineterm=""))[2:]
    if not lines:
        put("p", "The two are the same.", "of")
        return
    with put("pre", classes="difference", data_difference="", aria_label=json.dumps("What changes in the model file")):
        for line in lines:
            kind = {"+": "came", "-": "went", "@": "where"}.get(line[:1], "same")
            put("span", line if line.strip() else " ", kind)

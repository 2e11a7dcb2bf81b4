"""The steps and the model: go back and forth, leave effects out or add others, and what a step changes in the file."""

from __future__ import annotations

from functools import partial

from runtime.studio.documents import EffectOffered
from runtime.studio.history import PlacedEffect, SessionStep
from runtime.studio.page.start import described, undo_buttons
from runtime.studio.page.view import TAGS, PageView, button, folded, put
from runtime.wording import percent


def history(view: PageView) -> None:
    """All steps with the error of the joint that is shown."""
    studio, busy = view.studio, view.busy
    put("h2", "Steps")
    with put("div", classes="acts"):
        undo_buttons(view)
    with put("ol", classes="steps"):
        for step in studio.history.steps:
            joint, current = step.joints[view.joint.joint - 1], "step" if step is view.here else None
            with put("li"):
                pressed = put("button", classes="step", type="button", aria_current=current, data_step=step.number)
                pressed.props["disabled"] = busy
                with pressed.on("click", partial(lambda number, _: view.give(studio.go_to, number), step.number)):
                    put("span", str(step.number), "step-number")
                    put("span", step.title, "step-title")
                    if step.inputs != view.step.inputs:
                        put("span", "with other inputs", "of")
                    held = "" if joint.held is None else f", held out {percent(joint.held)}"
                    put("span", percent(joint.relative) + held, "step-error")
                    if step.verdict is not None:
                        put("span", TAGS.get(step.verdict, step.verdict), f"tag {step.verdict}")


def model(view: PageView) -> None:
    """The effects in the model with their values, each with a button that leaves it out."""
    joint, several = view.joint, len(view.overview.joints) > 1
    active = [effect for effect in view.overview.active if effect.placed.joint in (None, joint.joint)]
    put("h2", "Effects in the model" + (f", joint {joint.called} and the whole arm" if several else ""))
    if not active:
        put("p", "None: only rigid bodies.", "of")
    with put("ul", classes="effects"):
        for effect in active:
            with put("li"):
                put("b", str(effect.placed))
                put("span", effect.values, "of")
                button(
                    "Leave out",
                    partial(view.act, view.studio.without, effect.placed),
                    disabled=view.closed,
                    title=f"Fit without {effect.placed}, to see its share",
                    data_do="without",
                )


def library(view: PageView) -> None:
    """Choose an effect of the library and its place, and add it."""
    put("h2", "Add another effect")
    put("p", "The model is fitted with it to the same recordings. Undo removes it.", "of")
    offered = offers(view)
    if not offered:
        put("p", "Every effect of the library is in the model.", "of")
        return
    placed = chosen_effect(offered, view.offered)
    texts = {name: effect.title for name, effect in offered.items()}
    chosen = offered[placed.effect]
    with put("div", classes="acts"):
        view.effect_choice("offered", texts, chosen.places, placed)
        button(f"Add {placed}", lambda: view.act(view.studio.add, placed), disabled=view.closed, data_do="try")
    put("p", chosen.summary)
    with put("p"):
        put("code", f"torque = {chosen.equation}")


def offers(view: PageView) -> dict[str, EffectOffered]:
    """The effects that may be added, by name."""
    found = view.studio.answer(view.step.number, "library", list[EffectOffered]) or []
    return {effect.effect: effect for effect in found if effect.places}


def chosen_effect(offered: dict[str, EffectOffered], wanted: tuple[str, int | None] | None) -> PlacedEffect:
    """The wanted effect at the wanted place, or the first ones where that is not offered."""
    name, joint = wanted or ("", None)
    found = offered.get(name) or next(iter(offered.values()))
    return PlacedEffect(found.effect, joint if joint in found.places else found.places[0])


def change(view: PageView) -> None:
    """Downloads, what the step changes in the model file, and the commands that do the same."""
    studio, here = view.studio, view.step
    put("h2", "The model file")
    downloads = {"model": "Download the model file", "commands": "Download the commands"}
    if studio.file(here.number, "report.html") is not None:
        downloads["report"] = "Download the report"
    with put("div", classes="acts"):
        for what, text in downloads.items():
            put("a", text, "download", href=f"/download/{what}?step={here.number}", download="")
    described(view)
    put("file-drop", as_="model", label="Another model file, URDF or MJCF: the steps can be fitted again with it")
    others = {str(s.number): f"step {s.number}: {s.title}" for s in studio.history.steps if s is not here}
    against = view.against if view.against != here.number else None
    view.choice(
        "against",
        "Compare this step with",
        options={"": "the file as it was given", **others},
        value="" if against is None else str(against),
        chosen=lambda value: view.set(against=int(value) if value else None),
    )
    if against is not None:
        _errors(studio.history.step(against), here)
    lines = studio.difference(here.number, against)
    if not lines:
        put("p", "The two files are the same.", "of")
    else:
        with put("pre", classes="difference", data_difference="", aria_label="Changes in the model file"):
            for line in lines:
                kind = {"+": "came", "-": "went", "@": "where"}.get(line[:1], "same")
                put("span", line if line.strip() else " ", kind)
    with folded("The commands that do the same in a terminal"):
        put("pre", "\n".join(studio.commands(here.number)), data_commands="")


def _errors(other: SessionStep, here: SessionStep) -> None:
    """A table of the errors of two steps."""
    heads = [f"step {s.number}{held}" for held in ("", ", held out") for s in (other, here)]
    with put("div", classes="scroll"), put("table", classes="stack"):
        with put("thead"), put("tr"):
            for head in ("joint", *(heads if here.joints and here.joints[0].held is not None else heads[:2])):
                put("th", head, scope="col")
        with put("tbody"):
            for before, after in zip(other.joints, here.joints, strict=True):
                with put("tr"):
                    put("th", after.called, scope="row")
                    values = (before.relative, after.relative, before.held, after.held)
                    for head, value in zip(heads, values, strict=True):
                        if value is not None:
                            put("td", percent(value), "n", data_is=head)

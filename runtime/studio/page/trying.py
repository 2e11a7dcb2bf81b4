"""What may be asked of the fitted model: other values of an effect, an effect hidden in the motion, and the motion that
tells rivals apart."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from runtime.studio.history import PlacedEffect
from runtime.studio.page.parts import button, put
from runtime.studio.page.view import PageView
from runtime.studio.shown import Row, TriedShown
from runtime.wording import number, percent, quantity, sentence

STEPS = 100
"""of a slider over its range: what a hand can tell on a screen."""


def key(view: PageView) -> object:
    """What the section shows: another step, other answers, work that begins or ends."""
    if view.here is None:
        return None
    step, studio = view.here.number, view.studio
    answers = repr((studio.tried(step), studio.hidden(step), studio.experiment(step)))
    return step, view.here.verdict, view.busy, view.tried_effect, view.hidden_effect, answers


def trying(view: PageView) -> None:
    """Three questions, and their answers."""
    put("h2", "Ask the model")
    _other_values(view)
    _hiding(view)
    if view.verdict is not None and view.verdict["findings"]:
        _deciding(view)


# --- other values ---


def _other_values(view: PageView) -> None:
    """A slider for each parameter of an effect that the model has."""
    put("h3", "What would be left with other values?")
    active = {str(_effect(e)): e for e in view.shown["active"] if any(map(_movable, e["ranges"]))}
    if not active:
        put("p", "The model has no effect whose values could be tried; add one.", "of")
        return
    put("p", "Everything else stays as it was fitted, and nothing is written into the model.", "of")
    name = view.tried_effect if view.tried_effect in active else next(reversed(active))
    with put("div", classes="acts"):
        options = [(n, n) for n in active]
        view.controls.choice("tried", "effect", options, name, lambda value: view.set(tried_effect=value))
    values(view, active[name])


def values(view: PageView, row: Row, prefix: str = "") -> None:
    """A slider for each value of an effect, of the model or named, and what would be left with what they are set to.

    prefix   of the sliders' marks: the same effect may have them in two places
    """
    effect = _effect(row)
    answer = _answer(view, effect)
    units = {parameter["name"]: parameter["unit"] for parameter in row["parameters"]}
    for entry in filter(_movable, row["ranges"]):
        tried = {} if answer is None else answer["values"]
        _slider(view, effect, entry, tried, (units[entry["name"]], f"try-{prefix}{entry['name']}"))
    if answer is not None:
        _left(answer)


def _effect(row: Row) -> PlacedEffect:
    return PlacedEffect(row["effect"], row["joint"])


def _movable(entry: Row) -> bool:
    """Whether there is a range of values to try."""
    return None not in (entry["value"], entry["low"], entry["high"]) and bool(entry["high"] > entry["low"])


def _answer(view: PageView, effect: PlacedEffect) -> TriedShown | None:
    """What was tried of an effect last, if that was the last one."""
    assert view.here is not None
    found = view.studio.tried(view.here.number)
    return found if found is not None and PlacedEffect(found["effect"], found["joint"]) == effect else None


def _slider(view: PageView, effect: PlacedEffect, entry: Row, tried: dict[str, float], about: tuple[str, str]) -> None:
    name, low, high = entry["name"], entry["low"], entry["high"]
    unit, mark = about

    def moved(said: str) -> None:
        view.act(lambda: view.studio.try_values(effect, {**tried, name: float(said)}))

    value = tried.get(name, entry["value"])
    label = f"{name}: {number(value)} {unit}, fitted {number(entry['value'])}"
    span = {"min": low, "max": high, "step": (high - low) / STEPS, "value": value}
    with put("div", classes="acts"):
        view.controls.slider(f"{mark} of {effect}", label, moved, **span, disabled=view.busy or None, data_do=mark)


def _left(answer: TriedShown) -> None:
    """The error with the values that were tried, and the residual before and after."""
    for joint in answer["joints"]:
        was, is_ = percent(joint["fitted"]), percent(joint["relative"])
        put("p", f"Joint {joint['joint']}: error {was} as fitted, {is_} with these values.", role="status")
        put("tendon-signals", src=f"/data/{joint['signals']}")


# --- an effect hidden in the motion ---


def _hiding(view: PageView) -> None:
    """Choose an effect; the model is recorded with it along the user's motion, and that recording is diagnosed."""
    assert view.here is not None
    put("h3", "Would I see an effect in this motion?")
    put("p", "Hidden in a simulation along your motion, of moderate size, beside the noise of your recording.", "of")
    offered = {e["effect"]: e["places"] for e in view.studio.library(view.here.number) if e["places"]}
    if not offered:
        put("p", "Every effect of the library is in the model.", "of")
        return
    name, joint = view.hidden_effect or ("", None)
    name = name if name in offered else next(iter(offered))
    places = {"arm" if p is None else str(p): p for p in offered[name]}
    place = joint if joint in offered[name] else offered[name][0]
    with put("div", classes="acts"):
        options = [(e, e) for e in offered]
        view.controls.choice("hidden", "effect", options, name, lambda v: view.set(hidden_effect=(v, place)))
        if len(places) > 1:
            where = [(text, f"joint {text}") for text in places]
            chosen = "arm" if place is None else str(place)
            view.controls.choice(
                "hidden-where", "where", where, chosen, lambda text: view.set(hidden_effect=(name, places[text]))
            )
        ask = partial(view.act, partial(view.studio.hide, PlacedEffect(name, place), {}))
        button(f"Hide {PlacedEffect(name, place)}", ask, disabled=view.busy, data_do="hide")
    _seen(view)


def _seen(view: PageView) -> None:
    """The answer to what was hidden last."""
    assert view.here is not None
    answer = view.studio.hidden(view.here.number)
    if answer is None:
        return
    values = ", ".join(f"{name} {number(value)}" for name, value in answer["values"].items())
    with put("p", role="status"):
        put("strong", "Yes, it would be named: " if answer["seen"] else "No, it would not be named: ")
        noise = f"beside noise of {percent(answer['noise'])} of the torque"
        put("span", f"{PlacedEffect(answer['effect'], answer['joint'])}{f' with {values}' if values else ''}, {noise}.")
    if answer["problem"] is not None:
        put("p", sentence(answer["problem"]), "of")


# --- the motion that decides ---


def _deciding(view: PageView) -> None:
    """For every finding, a motion that tells it from its rivals, or from the model as it is."""
    assert view.here is not None
    assert view.verdict is not None
    put("h3", "Which motion would decide?")
    put("p", "Designed within the limits of the model file and tried in simulation; that takes some minutes.", "of")
    with put("div", classes="acts"):
        for card in view.verdict["findings"]:
            designing(view, [_effect(row) for row in (card, *card["rival_terms"])])
    answer = view.studio.experiment(view.here.number)
    if answer is not None:
        put("p", sentence(answer["reason"]), role="status")
        put("p", f"{quantity(answer['motion']['seconds'], 's', 3)}: {', '.join(answer['motion']['pieces'])}")
    if view.studio.motion(view.here.number) is not None:
        href = f"/download/motion?step={view.here.number}"
        put("a", "Download the motion for your controller (CSV)", href=href, download="")


def designing(view: PageView, effects: Sequence[PlacedEffect]) -> None:
    """A button that designs the motion which tells effects apart, or one from the model as it is."""
    ask = partial(view.act, partial(view.studio.design, *effects))
    button(f"Design a motion: {' or '.join(map(str, effects))}", ask, disabled=view.busy, data_do="design")

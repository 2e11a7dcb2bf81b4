"""Questions about the fitted model: other values of an effect, an effect hidden in the motion, the motion that
distinguishes rivals."""

from __future__ import annotations

from functools import partial

from runtime.report import replays
from runtime.studio.documents import (
    EffectOverview,
    HiddenEffectAnswer,
    MotionAnswer,
    ParameterRange,
    ReplayAnswer,
    ValuesAnswer,
)
from runtime.studio.page.steps import chosen_effect, offers
from runtime.studio.page.view import PageView, arm_in_motion, button, put, report_sections, signals
from runtime.wording import number, percent, quantity, sentence

STEPS = 100
"""Positions of a slider: as many as a hand distinguishes on a screen."""


def answers(view: PageView) -> tuple[object, ...]:
    """The answers at the current step, None where a question was not asked."""
    kinds = {"tried": ValuesAnswer, "hidden": HiddenEffectAnswer, "experiment": MotionAnswer, "replay": ReplayAnswer}
    return tuple(view.studio.answer(view.step.number, name, kind) for name, kind in kinds.items())


def ask(view: PageView) -> None:
    """The questions that need no diagnosis, and the answers."""
    put("h2", "Ask the model")
    put("h3", "How large is the error with other values?")
    active = {str(e.placed): e for e in view.overview.active if any(r.movable for r in e.ranges)}
    if not active:
        put("p", "The model has no effect with values to try; add one.", "of")
    else:
        put("p", "All other values stay as fitted, and the model does not change.", "of")
        name = view.tried_effect if view.tried_effect in active else next(reversed(active))
        with put("div", classes="acts"):
            view.choice(
                "tried",
                "effect",
                options={n: n for n in active},
                value=name,
                chosen=lambda value: view.set(tried_effect=value),
            )
        sliders(view, active[name])
    _replay(view)
    _hiding(view)
    _motion(view)


def sliders(view: PageView, effect: EffectOverview, prefix: str = "") -> None:
    """A slider for each value of an effect, and the error with the values that were tried.

    prefix   of the sliders' names: an effect of a finding and of the model may both have them
    """
    answer = view.studio.answer(view.step.number, "tried", ValuesAnswer)
    if answer is not None and answer.placed != effect.placed:
        answer = None
    tried = {} if answer is None else answer.values

    def moved(name: str, said: str) -> None:
        view.act(view.studio.try_values, effect.placed, {**tried, name: float(said)})

    for entry in effect.ranges:
        if entry.movable:
            low, high = entry.low or 0.0, entry.high or 0.0
            value, mark = tried.get(entry.name, entry.value), f"try-{prefix}{entry.name}"
            with put("div", classes="acts"):
                view.slider(
                    f"{mark} of {effect.placed}",
                    _said(entry, value),
                    partial(moved, entry.name),
                    min=low,
                    max=high,
                    step=(high - low) / STEPS,
                    value=value,
                    disabled=view.closed or None,
                    data_do=mark,
                )
    for joint in answer.joints if answer is not None else []:
        errors = f"error {percent(joint.fitted)} as fitted, {percent(joint.relative)} with these values"
        put("p", f"Joint {joint.joint}: {errors}.", role="status")
        signals(joint.signals)


def _said(entry: ParameterRange, value: float | None) -> str:
    ends = f"{number(entry.low)} to {number(entry.high)} {entry.unit}".strip()
    return f"{entry.name}: {f'{number(value)} {entry.unit}'.strip()} (fitted {number(entry.value)}, range {ends})"


def _replay(view: PageView) -> None:
    """The model is driven by the recorded torques; its motion, beside that of the step before."""
    put("h3", "Does the model move as the arm did?")
    put(
        "p",
        "The recorded torque drives the model, from the recorded state on; what was held out, if anything was.",
        "of",
    )
    with put("div", classes="acts"):
        button("Replay", partial(view.act, view.studio.replay), disabled=view.closed, data_do="replay")
    answer = view.studio.answer(view.step.number, "replay", ReplayAnswer)
    if answer is not None:
        put("p", sentence(replays.headline(answer.steps)), role="status")
        report_sections(replays.errors(answer.steps))
        if answer.arm is not None:
            arm_in_motion(answer.arm)
        href = f"/download/replay?step={view.step.number}"
        put("a", "Download the page with the arm in motion", "download", href=href, download="")


def _hiding(view: PageView) -> None:
    """Choose an effect. The model is simulated with it along the recorded motion, and that simulation is diagnosed."""
    put("h3", "Would an effect be named in this motion?")
    put(
        "p",
        "Your motion is simulated with an effect of moderate size and the noise of your recording, and diagnosed.",
        "of",
    )
    offered = offers(view)
    if not offered:
        put("p", "Every effect of the library is in the model.", "of")
        return
    effect = chosen_effect(offered, view.hidden_effect)
    with put("div", classes="acts"):
        texts, places = {name: name for name in offered}, offered[effect.effect].places
        view.effect_choice("hidden_effect", texts, places, effect)
        ask_it = partial(view.act, view.studio.hide, effect, {})
        button(f"Hide {effect}", ask_it, disabled=view.closed, data_do="hide")
    answer = view.studio.answer(view.step.number, "hidden", HiddenEffectAnswer)
    if answer is not None:
        values = ", ".join(f"{name} {number(value)}" for name, value in answer.values.items())
        with put("p", role="status"):
            put("strong", "Yes, it would be named: " if answer.seen else "No, it would not be named: ")
            noise = f"beside noise of {percent(answer.noise)} of the torque"
            put("span", f"{answer.placed}{f' with {values}' if values else ''}, {noise}.")
        if answer.problem is not None:
            put("p", sentence(answer.problem), "of")


def _motion(view: PageView) -> None:
    """The motion that was designed."""
    answer = view.studio.answer(view.step.number, "experiment", MotionAnswer)
    if answer is None:
        return
    put("h3", "The designed motion")
    put("p", sentence(answer.reason), role="status")
    put("p", f"{quantity(answer.motion.seconds, 's', 3)}: {', '.join(answer.motion.pieces)}")
    if view.studio.file(view.step.number, "motion.csv") is not None:
        href = f"/download/motion?step={view.step.number}"
        put("a", "Download the motion for your controller (CSV)", href=href, download="")

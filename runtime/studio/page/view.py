"""What the sections of the page are made of: HTML elements, controls, the report's parts, and what a browser tab shows.

Texts are texts: only the report's templates make HTML, and they escape what they are given.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from markupsafe import Markup
from nicegui import ui
from nicegui.element import Element
from nicegui.elements.mixins.text_element import TextElement
from nicegui.events import GenericEventArguments

from runtime.report.page.html import embedded, fragment, part, script, stylesheet
from runtime.report.sections import Section
from runtime.report.signals import SCRIPTS
from runtime.studio.documents import JointOverview, Row, StepOverview, VerdictOverview
from runtime.studio.history import PlacedEffect, SessionStep
from runtime.studio.studio import Studio

TAGS = {"effect": "effect found", "more": "effect found, more is left", "clean": "clean"}
"""Verdicts in words, where these are others."""


def add_head() -> None:
    """Styles and scripts of the report, of the signals and of the page."""
    ui.add_head_html(f"<style>{stylesheet()}</style>")
    ui.add_head_html('<link rel="stylesheet" href="/static/page/studio.css">')
    ui.add_body_html(f"<script>{script()}</script>")
    for name in SCRIPTS:
        ui.add_body_html(f'<script src="/static/signals/{name}"></script>')
    ui.add_body_html('<script src="/static/page/studio.js"></script>')


def put(tag: str, text: str = "", classes: str = "", **attributes: Any) -> Element:
    """An element with a text. In names of attributes `_` stands for a dash; an attribute that is None is left out."""
    made: Element = TextElement(tag=tag, text=text) if text else Element(tag)
    if classes:
        made.classes(classes)
    for name, value in attributes.items():
        if value is not None:
            made.props[name.rstrip("_").replace("_", "-")] = value
    return made


def button(text: str, act: Callable[[], Any], classes: str = "", **attributes: Any) -> Element:
    """A button; `disabled=True` where it cannot be pressed."""
    disabled = attributes.pop("disabled", None) or None
    return put("button", text, classes, type="button", disabled=disabled, **attributes).on("click", lambda _: act())


def report_sections(sections: Sequence[Section], level: int = 4) -> None:
    """Sections of the report; level: of their headings."""
    _markup(fragment(sections, level))


def arm_in_motion(arm: Row) -> Element:
    """The report's picture of the arm. A click on a joint is an event "joint" with its number, from 0."""
    picture = {**arm, "data": Markup(embedded(arm["data"]))}
    return _markup(part("arm_motion.html.j2", "arm_motion", picture), "arm-picture")


def _markup(text: Markup, classes: str = "") -> Element:
    """HTML from a template. NiceGUI's own element for HTML runs a script in the browser, which the policy forbids."""
    return put("div", classes=classes, innerHTML=str(text))


def signals(name: str, **attributes: Any) -> None:
    """The canvases of a signal set."""
    put("tendon-signals", src=f"/data/{name}", **attributes)


@contextmanager
def folded(title: str, open_: bool = False) -> Iterator[None]:
    """Content that unfolds by a click."""
    with put("details", open=open_ or None):
        put("summary", title)
        yield


WRONG = (LookupError, TypeError, ValueError, AttributeError, OSError, ArithmeticError)
"""Errors that come of a session with unexpected content: the folder may be anyone's."""


class PageSection:
    """A part of the page, drawn again whenever its key changes. A key of None hides it."""

    def __init__(self, place: Element, key: Callable[[], object], draw: Callable[[], None]) -> None:
        self._place, self._key, self._draw = place, key, draw
        self._drawn: object = None
        place.set_visibility(False)

    def look(self) -> None:
        """Draw it if its key has changed."""
        problem = None
        try:
            key = self._key()
        except WRONG as error:
            key = problem = repr(error)
        if key == self._drawn:
            return
        self._drawn = key
        self._place.clear()
        self._place.set_visibility(key is not None)
        if key is None:
            return
        with self._place:
            if problem is None:
                try:
                    self._draw()
                except WRONG as error:
                    problem = repr(error)
                    self._place.clear()
            if problem is not None:
                put("p", f"This part of the session cannot be shown: {problem}", "warning", role="alert")


class PageView:
    """A session as one browser tab shows it.

    chosen         joint that is shown, 1-based, and at which step, as long as that is shown; None: see `joint`
    held_out       whether its held-out recording is shown
    against        step with which the current one is compared; None: the model as given
    offered        effect and joint that may be added
    tried_effect   effect of the model whose values may be tried
    hidden_effect  effect and joint that may be hidden in the motion
    constants      joint -> torque constant of its motor, N m/A, as typed
    choices        recording, by its name in `given/` -> the columns that are being chosen
    refused        why the last command was refused; ""
    """

    def __init__(self, studio: Studio) -> None:
        self.studio = studio
        self.chosen: tuple[SessionStep, int] | None = None
        self.held_out = False
        self.against: int | None = None
        self.offered: tuple[str, int | None] | None = None
        self.tried_effect: str | None = None
        self.hidden_effect: tuple[str, int | None] | None = None
        self.constants: Mapping[int, str] = {}
        self.choices: Mapping[str, Mapping[str, str]] = {}
        self.refused = ""
        self.changed: Callable[[], None] = lambda: None
        self._controls: dict[str, tuple[Element, Callable[[str], Any]]] = {}

    @property
    def here(self) -> SessionStep | None:
        """The current step."""
        return self.studio.history.here

    @property
    def step(self) -> SessionStep:
        """The current step, where there is one."""
        assert self.here is not None
        return self.here

    @property
    def given(self) -> SessionStep:
        """The model as given, fitted to the same inputs as the current step."""
        return self.studio.history.path(self.step.number)[0]

    @property
    def busy(self) -> bool:
        """Whether a task is running."""
        work = self.studio.work
        return work is not None and work.state == "running"

    @property
    def closed(self) -> bool:
        """Whether nothing can be asked of the current step: a task is running, or its inputs have changed."""
        return self.busy or not self.studio.state.fitted

    @property
    def overview(self) -> StepOverview:
        """The current step's model."""
        found = self.studio.answer(self.step.number, "overview", StepOverview)
        if found is None:
            raise LookupError(f"step {self.step.number} has no overview.json")
        return found

    @property
    def verdict(self) -> VerdictOverview | None:
        """The current step's diagnosis; None before it."""
        return None if self.here is None else self.studio.answer(self.here.number, "verdict", VerdictOverview)

    @property
    def joint(self) -> JointOverview:
        """The joint that is shown: the one that was chosen at this step, else that of the first finding, of the effect
        that was added or left out, or with the largest residual in noise floors."""
        joints, step, found = self.overview.joints, self.step, self.verdict
        wanted: int | None = None
        if self.chosen is not None and self.chosen[0] == step:
            wanted = self.chosen[1]
        elif found is not None and found.findings:
            wanted = found.findings[0].shows_at
        elif step.changed:
            wanted = step.changed[0].joint
        shown = next((joint for joint in joints if joint.joint == wanted), None)
        return shown or max(joints, key=lambda joint: joint.floors or 0.0)

    def show_joint(self, number: int) -> None:
        """Show another joint, from 1."""
        self.set(chosen=(self.step, number))

    def act(self, command: Callable[..., Any], *given: Any) -> None:
        """Execute a command; if it is refused the page says why."""
        try:
            command(*given)
            self.refused = ""
        except (ValueError, RuntimeError, OSError) as error:
            self.refused = str(error)
        self.changed()

    def give(self, command: Callable[..., Any], *given: Any) -> None:
        """Change the inputs, and read what has to be read for that."""

        def both() -> None:
            command(*given)
            self.studio.read()

        self.act(both)

    def set(self, **values: Any) -> None:
        """Show something else."""
        for name, value in values.items():
            setattr(self, name, value)
        self.changed()

    # Controls. A value is assigned by the control's name and not by its element: the element may have been replaced
    # before the server receives it. The control with that name then takes the value.

    def choice(
        self, name: str, label: str, *, options: dict[str, str], value: str, chosen: Callable[[str], Any]
    ) -> None:
        """A list of options, value -> text."""
        with put("label", classes="choice"):
            if label:
                put("span", label)
            with put("select", value=value, data_control=name, aria_label=None if label else name) as made:
                for key, text in options.items():
                    put("option", text, value=key, selected=(key == value) or None)
        self._controls[name] = made, lambda said: chosen(said) if said in options else None

    def effect_choice(self, name: str, effects: dict[str, str], places: list[int | None], value: PlacedEffect) -> None:
        """Lists of effects, name -> text, and of the places of one. The choice becomes the attribute `name`."""
        self.choice(
            name,
            "effect",
            options=effects,
            value=value.effect,
            chosen=lambda effect: self.set(**{name: (effect, value.joint)}),
        )
        if len(places) > 1:
            texts = {json.dumps(p): "whole arm" if p is None else f"joint {p}" for p in places}
            self.choice(
                f"{name}-where",
                "at",
                options=texts,
                value=json.dumps(value.joint),
                chosen=lambda place: self.set(**{name: (value.effect, json.loads(place))}),
            )

    def slider(self, name: str, label: str, moved: Callable[[str], Any], **attributes: Any) -> None:
        """A value between `min` and `max`; `disabled=True` where it cannot be moved."""
        with put("label", classes="choice"):
            put("span", label)
            made = put("input", type="range", data_control=name, **attributes)
        self._controls[name] = made, moved

    def entry(self, name: str, label: str, *, value: str, typed: Callable[[str], Any]) -> None:
        """A number that is typed."""
        with put("label", classes="choice"):
            put("span", label)
            made = put("input", type="number", min=0, step="any", value=value, data_control=name)
        self._controls[name] = made, typed

    def hear(self, event: GenericEventArguments) -> None:
        """Take the value to which the browser says that a control was set."""
        said = event.args["detail"]
        made, heard = self._controls.get(str(said["control"]), (None, None))
        if made is not None and heard is not None and not made.is_deleted:
            heard(str(said["value"]))

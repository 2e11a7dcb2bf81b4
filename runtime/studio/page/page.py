"""The page of a session: its sections, and the task that is running."""

from __future__ import annotations

from collections.abc import Callable

from nicegui import ui

from runtime.studio.page import joints, questions, start, steps, verdict
from runtime.studio.page.view import PageSection, PageView, add_head, button, put
from runtime.studio.studio import Studio
from runtime.wording import number

POLL = 0.25
"""s between two looks at the session's version: a person sees no delay."""


def build(studio: Studio) -> None:
    """The page of one browser tab."""
    add_head()
    view = PageView(studio)
    with put("div", classes="page").on("chosen", view.hear, ["detail"]):
        with put("header", classes="top"):
            put("span", "Tendon studio", "name")
            put("span", studio.session.folder.name, "of")
        sections = _sections(view)
    seen = studio.version

    def look() -> None:
        with studio.paused():
            for section in sections:
                section.look()

    def poll() -> None:
        nonlocal seen
        if studio.version != seen:
            seen = studio.version
            look()

    view.changed = look
    look()
    ui.timer(POLL, poll)


def _sections(view: PageView) -> list[PageSection]:
    """In the order of the page. The key of a section has everything on which its content depends."""
    studio = view.studio
    made: list[PageSection] = []

    def section(name: str, key: Callable[[], object], draw: Callable[[PageView], None], tag: str = "section") -> None:
        classes = "short" if name in ("start", "changed", "verdict") else ""
        made.append(PageSection(put(tag, id_=name, classes=classes), key, lambda: draw(view)))

    def step(*more: object) -> object:
        """A key of a section that shows a step."""
        return None if view.here is None else (view.here, view.busy, view.closed, *more)

    def read() -> object:
        """How far the recordings were read."""
        return [studio.recording(given) for given in studio.inputs.recordings]

    def joint() -> object:
        return None if view.here is None else (view.here, view.joint.joint)

    def task() -> object:
        """What of the task does not change with its progress."""
        work = studio.work
        return view.refused, None if work is None else (work.what, work.state, work.error)

    def found() -> object:
        if view.verdict is None or not view.verdict.findings:
            return None
        return step(view.joint.joint, questions.answers(view))

    with put("div", classes="at-work"):
        section("work", task, _work, "div")
        section("progress", lambda: studio.work if view.busy else None, _progress, "div")
        section("parts", lambda: view.here and step(joint()), joints.navigation, "nav")
    section("start", lambda: None if view.here else (studio.state, view.busy, read()), start.start)
    section(
        "changed",
        lambda: None if not view.here or studio.state.fitted else (step(), studio.state, read()),
        start.changed,
    )
    section("verdict", lambda: view.here and step(joint()), verdict.banner)
    with put("div", classes="columns"):
        with put("div"):
            section("errors", joint, joints.errors)
            section("history", lambda: view.here and step(joint(), studio.state), steps.history)
            section("model", lambda: view.here and step(joint()), steps.model)
        section("motion", lambda: view.here and (view.here, studio.inputs), joints.motion)
    section("joint", lambda: view.here and (joint(), view.held_out), joints.joint)
    section("findings", found, verdict.findings)
    section("try", lambda: step(view.offered), steps.library)
    section(
        "ask", lambda: view.here and step(view.tried_effect, view.hidden_effect, questions.answers(view)), questions.ask
    )
    section("change", lambda: step(view.against), steps.change)
    section("details", lambda: view.verdict and view.here, verdict.details)
    section(
        "recordings",
        lambda: (
            (studio.inputs, step(), view.busy, read(), view.choices, view.constants)
            if studio.inputs.recordings or view.here
            else None
        ),
        start.recordings,
    )
    section("plans", lambda: (view.busy, repr(studio.plans())), start.plans)
    section("afresh", lambda: step(), start.afresh)
    return made


def _work(view: PageView) -> None:
    """The running task, or why it ended without a result; and why a command was refused."""
    if view.refused:
        with put("div", classes="wrong", role="alert"):
            put("p", view.refused)
            button("Close", lambda: view.set(refused=""))
    task = view.studio.work
    if task is None or task.state == "done":
        return
    if task.state == "running":
        with put("div", classes="working", role="status"):
            put("b", f"{task.what[:1].upper()}{task.what[1:]} …")
            button("Cancel", lambda: view.act(view.studio.cancel), data_do="cancel")
        return
    with put("div", classes="wrong", role="alert"):
        if task.state == "cancelled":
            put("p", f"Cancelled: {task.what}. The session is as it was before.")
        else:
            put("p", task.error or "The task ended without a result.")


def _progress(view: PageView) -> None:
    """Parts and time of the running task."""
    task = view.studio.work
    assert task is not None
    put("progress", max=1, value=task.share, aria_label=task.what)
    with put("ol", classes="parts"):
        for k, part in enumerate(task.parts):
            state = "done" if k < task.at else "current" if k == task.at else "to-come"
            put("li", part, state, aria_current="step" if state == "current" else None)
    left = "" if task.left is None else f"about {number(max(task.left, 1.0), 2)} s left"
    put("p", ". ".join(filter(None, [*task.said[-1:], task.doing, left])), "of")

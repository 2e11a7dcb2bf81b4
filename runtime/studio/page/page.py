"""The page of a session: its sections, each drawn anew when what it shows has changed."""

from __future__ import annotations

from nicegui import ui

from runtime.report.page.filling import script, stylesheet
from runtime.report.signals import SCRIPTS
from runtime.studio.page import arm, joint_views, library, start, steps, trying, verdict, working
from runtime.studio.page.parts import PageSection, put
from runtime.studio.page.view import PageView
from runtime.studio.studio import Studio

LOOK = 0.25
"""s between two looks at the session's version: a person sees no delay."""


def build(studio: Studio) -> None:
    """The page of one browser tab."""
    _head()
    view = PageView(studio)
    with put("div", classes="page").on("chosen", view.controls.hear, ["detail"]):
        with put("header", classes="top"):
            put("span", "Tendon studio", "name")
            put("span", studio.session.folder.name, "of")
            put("theme-switch")
        sections = _sections(view)
    seen = studio.version

    def look() -> None:
        with studio.unchanged():
            for section in sections:
                section.look()

    def poll() -> None:
        nonlocal seen
        if studio.version != seen:
            seen = studio.version
            look()

    view.changed = look
    look()
    ui.timer(LOOK, poll)


def _head() -> None:
    """Styles and scripts: those of the report, of the signals, and the page's own."""
    ui.add_head_html(f"<style>{stylesheet()}</style>")
    ui.add_head_html('<link rel="stylesheet" href="/static/page/studio.css">')
    ui.add_body_html(f"<script>{script()}</script>")
    for name in SCRIPTS:
        ui.add_body_html(f'<script src="/static/signals/{name}"></script>')
    ui.add_body_html('<script src="/static/page/studio.js"></script>')


def _sections(view: PageView) -> list[PageSection]:
    """In the order of the page. Of what depends on a step the key says which, and what is known of it."""
    studio = view.studio

    def step() -> tuple[object, ...] | None:
        return None if view.here is None else (view.here, view.busy)

    def joint() -> tuple[object, ...] | None:
        return None if view.here is None else (view.here, view.joint["joint"])

    def judged() -> tuple[object, ...] | None:
        return None if view.here is None or view.verdict is None else (view.here, view.busy, view.joint["joint"])

    def found() -> tuple[object, ...] | None:
        if view.here is None or view.verdict is None or not view.verdict["findings"]:
            return None
        return judged(), repr(studio.tried(view.here.number))

    def signals() -> None:
        joint_views.signals(view, f"{view.here.number}-{view.here.verdict}" if view.here else "")

    with put("div", classes="at-work"):
        made = [
            PageSection("div", "work", lambda: (working.state(view), view.wrong), lambda: working.work(view)),
            PageSection("div", "progress", lambda: studio.work if view.busy else None, lambda: working.progress(view)),
        ]
    made += [
        PageSection(
            "section",
            "start",
            lambda: None if view.here else (studio.inputs, view.busy),
            lambda: start.start(view),
            classes="short",
        ),
        PageSection(
            "section",
            "verdict",
            lambda: joint() and (joint(), view.busy),
            lambda: verdict.banner(view),
            classes="short",
        ),
    ]
    with put("div", classes="columns"):
        with put("div"):
            made += [
                PageSection("section", "errors", joint, lambda: arm.joints(view)),
                PageSection(
                    "section",
                    "history",
                    lambda: step() and (step(), joint(), studio.history),
                    lambda: steps.history(view),
                ),
                PageSection("section", "model", lambda: step() and (step(), joint()), lambda: steps.model(view)),
            ]
        made.append(
            PageSection("section", "motion", lambda: step() and (view.here, studio.inputs), lambda: arm.picture(view))
        )
    made += [
        PageSection("section", "joint", lambda: joint() and (joint(), view.held_out), signals),
        PageSection("section", "findings", found, lambda: verdict.cards(view)),
        PageSection("section", "try", lambda: step() and (step(), view.offered), lambda: library.library(view)),
        PageSection("section", "ask", lambda: trying.key(view), lambda: trying.trying(view)),
        PageSection("section", "change", lambda: step() and (step(), view.against), lambda: steps.change(view)),
        PageSection("section", "beside", judged, lambda: verdict.beside(view)),
        PageSection(
            "section",
            "recordings",
            lambda: (studio.inputs, view.busy, len(studio.recordings())) if studio.inputs.recordings else None,
            lambda: start.recordings(view),
        ),
        PageSection("section", "plans", lambda: (view.busy, repr(studio.plans())), lambda: start.plans(view)),
    ]
    return made

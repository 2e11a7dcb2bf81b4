"""Inputs: a model and recordings, or the demo; what is wrong with a recording and its cures; plans."""

from __future__ import annotations

from functools import partial

from runtime.studio.documents import Cure, RecordingOverview
from runtime.studio.page.view import PageView, button, folded, put, signals
from runtime.studio.session import GivenRecording
from runtime.wording import number

ARMS = ("drive", "vishard4", "emps", "ur10", "panda")


def start(view: PageView) -> None:
    """Before the first fit: what is missing, and how to give it."""
    studio, inputs = view.studio, view.studio.inputs

    def demo() -> None:
        studio.give_demo()
        studio.begin()

    put("h1", "Where does your model fail, and which effect does it lack?")
    put("p", "Give a model of your arm and a recording of its motion. Nothing leaves this machine.")
    with put("div", classes="gives"):
        with put("section", classes="give"):
            put("h2", "1. Model")
            put("p", "none yet" if inputs.model is None else inputs.model.name, "given")
            put("file-drop", as_="model", label="Drop a model file (TOML), URDF or MJCF here, or choose one")
            view.choice(
                "arm",
                "or an arm that ships with Tendon",
                options={"": "choose", **{name: name for name in ARMS}},
                value=inputs.like or "",
                chosen=lambda name: view.act(studio.give_arm, name) if name else None,
            )
        with put("section", classes="give"):
            put("h2", "2. Recordings")
            put("p", ", ".join(r.given.name for r in inputs.recordings) or "none yet", "given")
            formats = "CSV, MCAP, ROS 2 bag, MATLAB, HDF5, Parquet, npz"
            put("file-drop", as_="fitted", label=f"Drop recordings to fit here: {formats}")
            put("file-drop", as_="held_out", label="Recordings to hold out: not fitted, only compared")
        with put("section", classes="give"):
            put("h2", "or the demo")
            put("p", "A simulated drive with an effect that its model lacks, and two recordings of it.")
            button("Open the demo", lambda: view.act(demo), "first", disabled=view.busy, data_do="demo")
    with put("div", classes="acts"):
        ready = inputs.complete and not view.busy
        button(
            "Compare the model with the recordings",
            lambda: view.act(studio.begin),
            "first" if ready else "",
            disabled=not ready,
            data_do="begin",
        )


def recordings(view: PageView) -> None:
    """Every recording: its sampling, what is wrong with it, and its raw signals."""
    studio = view.studio
    read = {shown.name: shown for shown in studio.recordings()}
    put("h2", "Recordings")
    for k, given in enumerate(studio.inputs.recordings, start=1):
        with put("article", classes="card"):
            _recording(view, k, given, read.get(given.given.name))
    if studio.history.steps:
        put("p", "Another recording starts a new comparison; the steps so far are no longer shown.", "of")
        with put("div", classes="gives"):
            put("file-drop", as_="fitted", label="Another recording to fit")
            put("file-drop", as_="held_out", label="Another recording to hold out")


def _recording(view: PageView, place: int, given: GivenRecording, shown: RecordingOverview | None) -> None:
    studio, disabled = view.studio, view.busy
    put("h3", given.given.name)
    with put("div", classes="acts"):
        put("span", "held out" if given.held_out else "fitted", "tag")
        text = "Fit it" if given.held_out else "Hold it out"
        button(text, lambda: view.act(studio.hold_out, place, not given.held_out), disabled=disabled)
        button("Remove", lambda: view.act(studio.remove_recording, place), disabled=disabled)
    if shown is None:
        put("p", "Not read yet.", "of")
        return
    if clock := shown.clock:
        gaps = f", {clock.gaps} gaps" if clock.gaps else ""
        put("p", f"{clock.samples} samples, {number(clock.seconds)} s at {number(clock.rate_hz)} Hz{gaps}", "of")
    if shown.problem:
        put("p", shown.problem, "warning", role="alert")
    cures(view, shown.cures)
    for joint, name in enumerate(shown.signals, start=1):
        with folded("Recorded signals" + (f", joint {joint}" if len(shown.signals) > 1 else "")):
            signals(name)


def cures(view: PageView, found: list[Cure]) -> None:
    """What looks wrong with the recordings, each with its cure."""
    for cure in found:
        with put("div", classes="cure"):
            put("p", cure.said)
            cure_button(view, cure)


def cure_button(view: PageView, cure: Cure) -> None:
    """Read the recordings with the cure and compare again; no button where a person has to decide."""
    studio = view.studio

    def read() -> None:
        studio.read_as([*studio.inputs.maps, *cure.maps], studio.inputs.allow_gaps or cure.gaps)
        studio.begin()

    if cure.maps or cure.gaps:
        text = "Split at the gaps" if cure.gaps else f"Read it with {', '.join(cure.maps)}"
        button(text, partial(view.act, read), "first", disabled=view.busy, data_do="cure")


def plans(view: PageView) -> None:
    """Trajectories, each a link to the report's page of it."""
    put("h2", "Plans")
    put("file-drop", as_="plan", label="Drop a plan here (JSON of tendon optimize --out) to see its motion and limits")
    with put("ul", classes="effects"):
        for number_, plan in view.studio.plans().items():
            with put("li"):
                put("a", plan.name, href=f"/plan/{number_}", target="_blank", rel="noopener")
                put("span", plan.headline, "of")
                close = partial(view.act, view.studio.close_plan, number_)
                button("Close", close, disabled=view.busy, data_do=f"close-plan-{number_}")

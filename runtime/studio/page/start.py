"""Inputs: a model and recordings, or the demo; how each recording is read, and what looks wrong with it; plans."""

from __future__ import annotations

from functools import partial

from msgspec.structs import replace

from runtime.report.models import imported_arm
from runtime.studio.describe import spoken
from runtime.studio.documents import Cure, RecordingOverview
from runtime.studio.inputs import GivenRecording
from runtime.studio.page.columns import columns
from runtime.studio.page.view import PageView, button, folded, put, report_sections, signals
from runtime.wording import number

ARMS = ("drive", "vishard4", "emps", "ur10", "panda")


def start(view: PageView) -> None:
    """Before the first fit: what is missing, and how to give it."""
    studio, inputs = view.studio, view.studio.inputs

    def demo() -> None:
        studio.start_demo()
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
                chosen=lambda name: view.give(studio.give_arm, name) if name else None,
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
            if inputs.model is not None or inputs.recordings:
                put("p", "It takes the place of what you gave.", "of")
            button("Open the demo", lambda: view.act(demo), "first", disabled=view.busy, data_do="demo")
    if inputs.described is not None:
        with put("section", classes="give"):
            put("h2", f"The model of {inputs.described.file.name}")
            described(view)
    with put("div", classes="acts"):
        compare(view, "Compare the model with the recordings")
        undo_buttons(view)


def described(view: PageView) -> None:
    """What was assumed where a model file was made from a robot description, and between which links the arm lies."""
    arm = view.studio.inputs.described
    if arm is None:
        return
    if arm.problem:
        put("p", spoken(arm.problem), "warning", role="alert")
    base, tip = arm.base or "", arm.tip or ""

    def choose(base: str, tip: str) -> None:
        view.give(view.studio.choose_ends, base or None, tip or None)

    links = {link: link for link in arm.links}
    with put("div", classes="acts"):
        root, end = {"": "the root"}, {"": "the only end"}
        view.choice("base", "begins at", options=root | links, value=base, chosen=lambda link: choose(link, tip))
        view.choice("tip", "ends at", options=end | links, value=tip, chosen=lambda link: choose(base, link))
    if arm.made is not None:
        with folded("What was assumed", open_=view.here is None):
            gravity = ", ".join(number(value) for value in arm.made.gravity)
            everywhere = [{name for name, values in joint.effects.items() if not values} for joint in arm.made.joints]
            with put("ul", data_assumed=""):
                if assumed := sorted(set.intersection(*everywhere)):
                    put("li", f"every joint is given {' and '.join(assumed)}, whose values are unknown")
                put("li", f"gravity is ({gravity}) m/s² in the axes of {arm.made.base}")
                for note in map(spoken, arm.made.notes):
                    put("li", note)
            report_sections(imported_arm(arm.made))


def compare(view: PageView, text: str) -> None:
    """The button that fits, and why it cannot be pressed yet."""
    studio, waits = view.studio, unready(view)
    ready = not (waits or view.busy)
    button(text, lambda: view.act(studio.begin), "first" if ready else "", disabled=not ready, data_do="begin")
    if waits:
        put("span", waits, "of")
        if studio.inputs.recordings:
            put("a", "See the recordings", href="#recordings")


def unready(view: PageView) -> str:
    """What has to be given or put right before a fit; "" if nothing."""
    studio, inputs = view.studio, view.studio.inputs
    if inputs.model is None:
        return "A model is missing." if inputs.described is None else "Choose where the arm ends."
    if not inputs.fitted:
        return "A recording to fit is missing."
    read = ((given.given.name, studio.recording(given)) for given in inputs.recordings)
    wrong = [name for name, shown in read if shown is not None and shown.problem is not None]
    return f"{', '.join(wrong)} cannot be used yet." if wrong else ""


def undo_buttons(view: PageView) -> None:
    """Undo and redo, of steps and of changes of the inputs."""
    studio, busy = view.studio, view.busy
    button("Undo", lambda: view.give(studio.undo), disabled=busy or not studio.state.undoable, data_do="undo")
    button("Redo", lambda: view.give(studio.redo), disabled=busy or not studio.state.redoable, data_do="redo")


def afresh(view: PageView) -> None:
    """A new start with another model, without leaving the session."""
    with folded("Start afresh"):
        put("p", "Model, recordings and steps are put aside; this cannot be undone.")
        button("Start afresh", lambda: view.act(view.studio.start_afresh), disabled=view.busy, data_do="afresh")


def changed(view: PageView) -> None:
    """That the inputs have changed since the current step was fitted, and what to do."""
    put("p", "The inputs have changed since this step was fitted. The steps stay as they are.")
    with put("div", classes="acts"):
        again = "Fit the steps again" if len(view.studio.history.path(view.step.number)) > 1 else "Fit again"
        compare(view, again)
        undo_buttons(view)


def recordings(view: PageView) -> None:
    """Every recording: its sampling, how it is read, what is wrong with it, and its raw signals."""
    studio = view.studio
    put("h2", "Recordings")
    for given in studio.inputs.recordings:
        with put("article", classes="card", data_recording=given.given.file):
            _recording(view, given, studio.recording(given))
    if studio.history.steps:
        put("p", "After another recording the steps can be fitted again, to all of them.", "of")
        with put("div", classes="gives"):
            put("file-drop", as_="fitted", label="Another recording to fit")
            put("file-drop", as_="held_out", label="Another recording to hold out")


def _recording(view: PageView, given: GivenRecording, shown: RecordingOverview | None) -> None:
    studio, disabled, file = view.studio, view.busy, given.given.file
    put("h3", given.given.name)
    with put("div", classes="acts"):
        put("span", "held out" if given.held_out else "fitted", "tag")
        text = "Fit it" if given.held_out else "Hold it out"
        button(text, lambda: view.give(studio.hold_out, file, not given.held_out), disabled=disabled)
        button("Remove", lambda: view.give(studio.remove_recording, file), disabled=disabled, data_do="remove")
    if shown is None:
        put("p", "Not read yet.", "of")
        return
    if clock := shown.clock:
        gaps = f", {clock.gaps} gaps" if clock.gaps else ""
        put("p", f"{clock.samples} samples, {number(clock.seconds)} s at {number(clock.rate_hz)} Hz{gaps}", "of")
    if shown.problem:
        put("p", shown.problem, "warning", role="alert")
    cures(view, shown.cures)
    _gaps(view, given)
    columns(view, given, shown)
    for joint, name in enumerate(shown.signals, start=1):
        with folded("Recorded signals" + (f", joint {joint}" if len(shown.signals) > 1 else "")):
            signals(name)


def _gaps(view: PageView, given: GivenRecording) -> None:
    """That the recording is split at its gaps, which can be taken back."""
    if given.reading.allow_gaps:
        whole = replace(given.reading, allow_gaps=False)
        with put("div", classes="acts"):
            put("span", "split at its gaps", "tag")
            read = partial(view.give, view.studio.read_as, given.given.file, whole)
            button("Do not split it", read, disabled=view.busy, data_do="whole")


def cures(view: PageView, found: list[Cure]) -> None:
    """What looks wrong with the recordings, each with its cure."""
    for cure in found:
        with put("div", classes="cure"):
            put("p", cure.said)
            cure_button(view, cure)


def cure_button(view: PageView, cure: Cure) -> None:
    """Read the recordings with the cure, and fit again where they are complete; none where a person has to decide."""
    studio = view.studio

    def read() -> None:
        studio.cure(cure)
        if studio.inputs.complete:
            studio.begin()
        else:
            studio.read()

    if cure.does:
        button(cure.does, partial(view.act, read), "first", disabled=view.busy, data_do="cure")


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

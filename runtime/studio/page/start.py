"""What is given: a model and recordings, or the demo; and what is wrong with a recording, with its cures."""

from __future__ import annotations

from functools import partial

from runtime.studio.page.parts import button, folded, put
from runtime.studio.page.view import PageView
from runtime.studio.session import GivenRecording
from runtime.studio.shown import Cure, RecordingShown
from runtime.wording import number

ARMS = ("drive", "vishard4", "emps", "ur10", "panda")


def start(view: PageView) -> None:
    """Before anything is fitted: what is still needed, and how to give it."""
    studio, inputs = view.studio, view.studio.inputs
    put("h1", "Where does your model fail, and what is missing in it?")
    put("p", "Give a model of your arm and a recording of it. Nothing leaves this machine.")
    with put("div", classes="gives"):
        with put("section", classes="give"):
            put("h2", "1. Model")
            put("p", _named(None if inputs.model is None else inputs.model.name), "given")
            put("file-drop", as_="model", label="Drop a model file (TOML), URDF or MJCF here, or choose one")
            view.controls.choice(
                "arm",
                "or an arm of Tendon",
                [("", "choose"), *((name, name) for name in ARMS)],
                inputs.like or "",
                lambda name: view.act(lambda: studio.give_arm(name)) if name else None,
            )
        with put("section", classes="give"):
            put("h2", "2. Recordings")
            put("p", _named(", ".join(r.given.name for r in inputs.recordings)), "given")
            put(
                "file-drop",
                as_="fitted",
                label="Drop recordings to fit here: CSV, MCAP, ROS 2 bag, MATLAB, HDF5, Parquet, npz",
            )
            put("file-drop", as_="held_out", label="Recordings to hold out and judge on")
        with put("section", classes="give"):
            put("h2", "or the demo")
            put("p", "A simulated drive with an effect that its model lacks, and two recordings of it.")
            button("Open the demo", lambda: view.act(lambda: _demo(view)), "first", disabled=view.busy, data_do="demo")
    with put("div", classes="acts"):
        ready = inputs.complete and not view.busy
        button(
            "Compare the model with the recordings",
            lambda: view.act(studio.begin),
            "first" if ready else "",
            disabled=not ready,
            data_do="begin",
        )


def _demo(view: PageView) -> None:
    view.studio.give_demo()
    view.studio.begin()


def _named(name: str | None) -> str:
    return name or "none yet"


def recordings(view: PageView) -> None:
    """Every recording: what is in it, what looks wrong, and its raw signals."""
    studio = view.studio
    looked = {shown["name"]: shown for shown in studio.recordings()}
    put("h2", "Recordings")
    for k, given in enumerate(studio.inputs.recordings, start=1):
        with put("article", classes="card"):
            _recording(view, k, given, looked.get(given.given.name))
    if studio.history.steps:
        put("p", "Another recording begins the comparison anew; the steps so far are then gone.", "of")
        with put("div", classes="gives"):
            put("file-drop", as_="fitted", label="Another recording to fit")
            put("file-drop", as_="held_out", label="Another recording to hold out")


def plans(view: PageView) -> None:
    """Trajectories that were opened, each a link to the report's page of it."""
    put("h2", "Plans")
    put("file-drop", as_="plan", label="Drop a plan here (JSON of tendon optimize --out) to see its motion and limits")
    with put("ul", classes="effects"):
        for number, plan in view.studio.plans().items():
            with put("li"):
                put("a", plan["name"], href=f"/plan/{number}", target="_blank", rel="noopener")
                put("span", plan["headline"], "of")
                remove = partial(view.act, view.studio.remove_plan, number)
                button("Close", remove, disabled=view.busy, data_do=f"close-plan-{number}")


def _recording(view: PageView, place: int, given: GivenRecording, shown: RecordingShown | None) -> None:
    studio, disabled = view.studio, view.busy
    put("h3", given.given.name)
    with put("div", classes="acts"):
        put("span", "held out, never fitted" if given.held_out else "fitted", "tag")
        text = "Fit to it" if given.held_out else "Hold it out"
        button(text, lambda: view.act(lambda: studio.hold_out(place, not given.held_out)), disabled=disabled)
        button("Take it away", lambda: view.act(lambda: studio.take_back(place)), disabled=disabled)
    if shown is None:
        put("p", "Not looked at yet.", "of")
        return
    clock = shown["inspection"].get("clock")
    if clock:
        rate = f"{clock['samples']} samples, {number(clock['seconds'])} s at {number(clock['rate_hz'])} Hz"
        put("p", rate + (f", {clock['gaps']} gaps" if clock["gaps"] else ""), "of")
    if shown["problem"]:
        put("p", shown["problem"], "warning", role="alert")
    cures(view, shown["cures"])
    for name in shown["signals"]:
        with folded(
            "Its signals as they were recorded"
            + (f", joint {name.rpartition('joint')[2]}" if len(shown["signals"]) > 1 else "")
        ):
            put("tendon-signals", src=f"/data/{name}")


def cures(view: PageView, found: list[Cure]) -> None:
    """What puts recordings right, each a button."""
    for cure in found:
        with put("div", classes="cure"):
            put("p", cure["said"])
            cure_button(view, cure)


def cure_button(view: PageView, cure: Cure) -> None:
    """Where no person must decide, the button that puts it right and compares again."""
    if cure["maps"] or cure["gaps"]:
        text = "Split at the gaps" if cure["gaps"] else f"Read it with {', '.join(cure['maps'])}"
        button(text, partial(view.act, _cure, view, cure), "first", disabled=view.busy, data_do="cure")


def _cure(view: PageView, cure: Cure) -> None:
    studio = view.studio
    studio.read_as([*studio.inputs.maps, *cure["maps"]], studio.inputs.allow_gaps or cure["gaps"])
    studio.begin()

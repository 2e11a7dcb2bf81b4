"""The joint that is looked into: its signals on the canvas, and beside them those of the held-out recording."""

from __future__ import annotations

from runtime.studio.page.parts import button, put
from runtime.studio.page.view import PageView
from runtime.wording import percent


def signals(view: PageView, mark: str) -> None:
    """Torque, prediction and residual over time, and the residual over every signal; `mark`: another for other data."""
    shown = view.joint
    put("h2", f"Joint {shown['called']}")
    follows = ", ".join(f"{name} ({percent(share, 0)})" for name, share in shown["structure"])
    if shown["at_floor"]:
        put("p", "What is left of this joint's torque is at its noise floor.", "of")
    elif follows:
        put("p", f"What is left of its torque follows {follows}.", "of")
    else:
        put("p", "What is left of its torque follows none of the signals that were recorded.", "of")
    if shown["signals"] is None:
        put("p", "This joint never moves in these recordings: nothing of it can be compared.", "warning")
        return
    if shown["held"] is not None:
        with put("div", classes="acts"):
            text = "Hide the held-out recording" if view.held_out else "Show the held-out recording beside it"
            button(text, lambda: view.set(held_out=not view.held_out), data_do="held-out")
    with put("div", classes="beside" if view.held_out and shown["held"] else ""):
        with put("div"):
            if view.held_out and shown["held"]:
                put("h3", "Fitted")
            put("tendon-signals", src=f"/data/{shown['signals']}", data_mark=mark)
        if view.held_out and shown["held"]:
            with put("div"):
                put("h3", "Held out")
                put("tendon-signals", src=f"/data/{shown['held']}", data_mark=mark)

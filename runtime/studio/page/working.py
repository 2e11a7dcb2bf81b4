"""What is worked on: how far it is, how long it still takes, and a way to end it."""

from __future__ import annotations

from runtime.studio.page.parts import button, put
from runtime.studio.page.view import PageView
from runtime.wording import number


def state(view: PageView) -> tuple[str, str, str | None] | None:
    """What of the work does not change with its progress."""
    work = view.studio.work
    return None if work is None else (work.what, work.state, work.error)


def work(view: PageView) -> None:
    """What is under way, or why it ended without a result; and why a command was refused."""
    if view.wrong:
        with put("div", classes="wrong", role="alert"):
            put("p", view.wrong)
            button("Close", lambda: view.set(wrong=""))
    found = view.studio.work
    if found is None or found.state == "done":
        return
    if found.state == "running":
        with put("div", classes="working", role="status"):
            put("b", f"{found.what[:1].upper()}{found.what[1:]} …")
            button("Cancel", lambda: view.act(view.studio.cancel), data_do="cancel")
        return
    with put("div", classes="wrong", role="alert"):
        if found.state == "cancelled":
            put("p", f"Cancelled: {found.what}. Nothing of it was kept; everything before it is as it was.")
        else:
            put("p", found.error or "The work ended without a result.")


def progress(view: PageView) -> None:
    """How far it is."""
    found = view.studio.work
    assert found is not None
    put("progress", max=1, value=found.share, aria_label=found.what)
    with put("ol", classes="parts"):
        for k, part in enumerate(found.parts):
            state = "done" if k < found.at else "current" if k == found.at else "to-come"
            put("li", part, state, aria_current="step" if state == "current" else None)
    left = "" if found.left is None else f"about {number(max(found.left, 1.0), 2)} s left of that"
    put("p", ". ".join(filter(None, [*found.said[-1:], found.doing, left])), "of")

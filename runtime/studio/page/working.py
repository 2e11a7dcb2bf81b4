"""What is worked on: how far it is, how long it still takes, and a way to end it."""

from __future__ import annotations

from runtime.studio.page.parts import button, folded, put
from runtime.studio.page.view import PageView
from runtime.wording import number


def progress(view: PageView) -> None:
    """Of work that is under way, or why it ended without a result."""
    work = view.studio.work
    if view.wrong:
        with put("div", classes="wrong", role="alert"):
            put("p", view.wrong)
            button("Close", lambda: view.set(wrong=""))
    if work is None or work.state == "done":
        return
    if work.state == "running":
        with put("div", classes="working", role="status"):
            with put("div", classes="working-line"):
                put("b", f"{work.what[:1].upper()}{work.what[1:]}")
                put("span", work.part, "of")
                if work.left is not None:
                    put("span", f"about {number(max(work.left, 1.0), 2)} s left of this part", "of")
                button("Cancel", lambda: view.act(view.studio.cancel), data_do="cancel")
            put("progress", max=1, value=work.share, aria_label=work.what)
            if work.said:
                with folded("What was done so far"):
                    for line in work.said:
                        put("p", line, "of")
        return
    with put("div", classes="wrong", role="alert"):
        if work.state == "cancelled":
            put("p", f"Cancelled: {work.what}. Nothing of it was kept; everything before it is as it was.")
        else:
            put("p", work.error or "The work ended without a result.")

"""The lists and sliders of a page.

What one is set to is heard by its name and not by its element: what the browser shows may have been drawn anew before
the server hears of it. The control that is then in its place hears it, so that nothing that was chosen is lost.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nicegui.element import Element
from nicegui.events import GenericEventArguments

from runtime.studio.page.parts import put


class Controls:
    """The controls of one browser tab. A name says what is decided, and is no other control's."""

    def __init__(self) -> None:
        self._drawn: dict[str, tuple[Element, Callable[[str], Any]]] = {}

    def choice(
        self, name: str, label: str, options: list[tuple[str, str]], value: str, chosen: Callable[[str], Any]
    ) -> None:
        """One of several (value, text), by a browser's own list."""
        with put("label", classes="choice"):
            put("span", label)
            with put("select", value=value, data_control=name) as made:
                for key, text in options:
                    put("option", text, value=key, selected=(key == value) or None)
        known = {key for key, _ in options}
        self._drawn[name] = made, lambda said: chosen(said) if said in known else None

    def slider(self, name: str, label: str, moved: Callable[[str], Any], **attributes: Any) -> None:
        """A value between `min` and `max`; `disabled=True` where it cannot be moved."""
        with put("label", classes="choice"):
            put("span", label)
            made = put("input", type="range", data_control=name, **attributes)
        self._drawn[name] = made, moved

    def hear(self, event: GenericEventArguments) -> None:
        """What the browser says that a control was set to; where there is none any more, nobody hears it."""
        said = event.args["detail"]
        made, heard = self._drawn.get(str(said["control"]), (None, None))
        if made is not None and heard is not None and not made.is_deleted:
            heard(str(said["value"]))

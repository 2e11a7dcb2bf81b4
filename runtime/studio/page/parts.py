"""The page's small parts: elements of HTML whose texts are texts, and sections that are drawn anew."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

from markupsafe import Markup
from nicegui.element import Element
from nicegui.elements.mixins.text_element import TextElement

from runtime.report.page.filling import part
from runtime.studio.session import SessionError


def put(tag: str, text: str = "", classes: str = "", **attributes: Any) -> Element:
    """An element with a text, which is shown as it stands; an attribute's `_` is a dash in HTML, None leaves it out."""
    made: Element = TextElement(tag=tag, text=text) if text else Element(tag)
    if classes:
        made.classes(classes)
    for name, value in attributes.items():
        if value is not None:
            made.props[name.rstrip("_").replace("_", "-")] = value
    return made


def button(text: str, act: Callable[[], Any], classes: str = "", **attributes: Any) -> Element:
    """A button that does something when it is pressed; `disabled=True` where it cannot."""
    disabled = attributes.pop("disabled", None) or None
    return put("button", text, classes, type="button", disabled=disabled, **attributes).on("click", lambda _: act())


def filled_part(macro: str, *holes: Any) -> None:
    """A part of the report's page; its macros escape every text."""
    markup(part("cards.html.j2", macro, *holes))


def markup(text: Markup, classes: str = "") -> Element:
    """HTML that was made by a template. NiceGUI's own way to show it has the browser make a script of a text, which
    the page's policy forbids."""
    return put("div", classes=classes, innerHTML=str(text))


@contextmanager
def folded(title: str, open_: bool = False) -> Iterator[None]:
    """Something that is read when it is wanted."""
    with put("details", open=open_ or None):
        put("summary", title)
        yield


WRONG = (LookupError, TypeError, ValueError, AttributeError, OSError, ArithmeticError)
"""What is raised of a session that holds something else than it should: the folder may be anyone's."""


class PageSection:
    """A part of the page that is drawn anew when what it shows is another: `key` says what that is.

    A key of None: it is not shown.
    """

    def __init__(
        self, tag: str, name: str, key: Callable[[], object], draw: Callable[[], None], **attributes: Any
    ) -> None:
        self._key, self._draw = key, draw
        self._drawn: object = None
        self._place = put(tag, id_=name, **attributes)
        self._place.set_visibility(False)

    def look(self) -> None:
        """Draw it, if it has changed."""
        try:
            key = self._key()
        except WRONG as error:
            key = _Wrong(str(error))
        if key == self._drawn:
            return
        self._drawn = key
        self._place.clear()
        self._place.set_visibility(key is not None)
        if key is not None:
            with self._place:
                try:
                    self._tell(key)
                except WRONG as error:
                    self._place.clear()
                    with self._place:
                        put("p", f"This part of the session cannot be shown: {error!r}", "warning")

    def _tell(self, key: object) -> None:
        if isinstance(key, _Wrong):
            raise SessionError(key.why)
        self._draw()


class _Wrong(NamedTuple):
    """Why it is not known what a section shows."""

    why: str

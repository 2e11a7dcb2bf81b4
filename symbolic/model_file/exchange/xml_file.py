"""Untrusted XML, read with limits: no entities; bounded size, elements and depth; errors with line numbers."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn
from xml.parsers import expat

from symbolic.model_file.checks import ModelError, printable, quote, read_bytes

MAX_BYTES = 16_000_000
MAX_ELEMENTS = 50_000
MAX_DEPTH = 64
"""Limits above what robots need: the largest file of example-robot-data has 0.3 MB, 4,000 elements and 60 levels."""
MAX_TEXT = 1000
"""Characters of text kept for an element; only transmissions' numbers are used."""

_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?|[-+]?(inf|infinity|nan)", re.ASCII | re.IGNORECASE)


@dataclass
class XmlNode:
    """An XML element with its location.

    start, close   byte offsets of its tag and of its closing tag, if it has one
    """

    tag: str
    attributes: Mapping[str, str]
    file: str
    line: int
    start: int = 0
    close: int = 0
    children: list[XmlNode] = field(default_factory=list)
    text: str = ""

    def fail(self, message: str) -> NoReturn:
        """Raise ModelError: file, line and message."""
        raise ModelError(f"{self.file} line {self.line}: {message}")

    def all(self, tag: str) -> Iterator[XmlNode]:
        """The child elements with this tag."""
        return (child for child in self.children if child.tag == tag)

    def first(self, tag: str) -> XmlNode | None:
        """The first child element with this tag, or None."""
        return next(self.all(tag), None)

    def everything(self) -> Iterator[XmlNode]:
        """All descendants, in document order."""
        todo = [*reversed(self.children)]
        while todo:
            node = todo.pop()
            yield node
            todo += reversed(node.children)

    def deep(self, tag: str) -> Iterator[XmlNode]:
        """The descendants with this tag."""
        return (node for node in self.everything() if node.tag == tag)

    def needed(self, tag: str) -> XmlNode:
        """The first child element with this tag. Raises ModelError if there is none."""
        found = self.first(tag)
        if found is None:
            self.fail(f"<{self.tag}> has no <{tag}>; expected one")
        return found

    def word(self, key: str) -> str:
        """An attribute that must not be missing or empty."""
        value = self.attributes.get(key, "")
        if not value.strip():
            self.fail(f'<{self.tag}> has no {key}; expected {key}="..."')
        return value

    def numbers(self, key: str, count: int, default: tuple[float, ...] | None = None) -> tuple[float, ...]:
        """An attribute of `count` finite numbers."""
        if key not in self.attributes and default is not None:
            return default
        words = self.word(key).split()
        if len(words) != count or not all(_NUMBER.fullmatch(word) for word in words):
            expected = "a number" if count == 1 else f"{count} numbers"
            self.fail(f"<{self.tag}> {key} is {quote(self.attributes[key])}; expected {expected}")
        values = tuple(map(float, words))
        if any(not abs(value) < float("inf") for value in values):
            self.fail(f"<{self.tag}> {key} is {quote(self.attributes[key])}; expected numbers that are finite")
        return values

    def number(self, key: str, default: float | None = None) -> float:
        """The number in an attribute, or `default` if it is missing. Raises ModelError."""
        return self.numbers(key, 1, None if default is None else (default,))[0]

    def bound(self, key: str) -> float | None:
        """A limit; None if it is missing or infinite."""
        word = self.attributes.get(key, "").strip()
        if word.lower().lstrip("+-") in ("inf", "infinity"):
            return None
        return self.number(key) if word else None


def read(path: Path) -> XmlNode:
    """The root of an XML file. Raises ModelError: no such file, not XML, an entity, or a limit exceeded."""
    data = read_bytes(path, MAX_BYTES, "a URDF or MJCF file")
    return parsed(data, printable(str(path)))


def parsed(data: bytes, name: str) -> XmlNode:
    """The root of a document. name: the file's, for messages. Raises ModelError."""
    parser, above, count = expat.ParserCreate(), [XmlNode("", {}, name, 0)], 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal count
        count += 1
        node = XmlNode(tag, attributes, name, line=parser.CurrentLineNumber, start=parser.CurrentByteIndex)
        if count > MAX_ELEMENTS:
            node.fail(f"more than {MAX_ELEMENTS:,} elements; expected the description of a robot")
        if len(above) > MAX_DEPTH:
            node.fail(f"elements within more than {MAX_DEPTH} others; expected the description of a robot")
        above[-1].children.append(node)
        above.append(node)

    def end(_: str) -> None:
        above.pop().close = parser.CurrentByteIndex

    def characters(text: str) -> None:
        if len(above[-1].text) < MAX_TEXT:
            above[-1].text += text[:MAX_TEXT]

    def entity(*_: Any) -> NoReturn:
        XmlNode("", {}, name, parser.CurrentLineNumber).fail(
            "declares an entity, which is not allowed; remove the document type and write the entity's content"
        )

    parser.buffer_text = True
    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler, parser.EntityDeclHandler = characters, entity
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        why = expat.ErrorString(error.code)
        said = _no_text(data, parser.ErrorByteIndex) if why == expat.errors.XML_ERROR_INVALID_TOKEN else ""
        raise ModelError(f"{name} line {error.lineno}: not valid XML: {said or why}") from None
    except (ValueError, LookupError) as error:
        if isinstance(error, ModelError):
            raise
        raise ModelError(f"{name}: not valid XML: {printable(str(error))}") from None
    return above[0].children[0]


PACKED = {b"\x1f\x8b": "gzip", b"PK\x03\x04": "zip", b"\xfd7zXZ": "xz"}
"""First bytes of compressed files."""


def _no_text(data: bytes, at: int) -> str:
    """Why the byte at which the parser stopped is not text; "" if it is."""
    packed = next((kind for start, kind in PACKED.items() if data.startswith(start)), None)
    if packed is not None:
        return f"the file is compressed ({packed}); decompress it first"
    try:
        data[at : at + 4].decode("utf-8")
    except UnicodeDecodeError as error:
        if error.start == 0 and error.reason != "unexpected end of data":
            return f"byte 0x{data[at]:02x} is not UTF-8; save the file as UTF-8, or state its encoding in line 1"
    return ""

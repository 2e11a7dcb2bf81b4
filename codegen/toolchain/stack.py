"""The worst stack of a Cortex-M image: frames as the compiler states them, calls from the machine code."""

from __future__ import annotations

import bisect
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from codegen.toolchain import thumb
from codegen.toolchain.elf import Elf, Symbol

EXCEPTION_FRAME = 108
"""Bytes that an exception pushes at most: 8 registers, 18 words of the floating-point unit, alignment."""


@dataclass(frozen=True)
class Stack:
    """The worst stack in bytes, and the calls that lead there.

    chain       function and its frame, from the reset handler inwards
    handlers    the worst that an exception adds: its own frame, its handler and what that calls
    unknown     why there is no bound: recursion, calls through pointers, frames the compiler does not state
    """

    main: int
    handlers: int
    chain: tuple[tuple[str, int], ...]
    unknown: tuple[str, ...]

    @property
    def worst(self) -> int:
        """Bytes that main and the deepest chain of interrupt handlers take together."""
        return self.main + self.handlers


def frames_of_usage(directory: Path) -> dict[str, int]:
    """What gcc's -fstack-usage wrote: the largest frame of a name's functions; frames without bound are left out."""
    frames: dict[str, int] = {}
    for path in sorted(directory.rglob("*.su")):
        for line in path.read_text().splitlines():
            place, size, kind = line.split("\t")
            name = place.split(":")[-1]
            if kind != "dynamic":
                frames[name] = max(int(size), frames.get(name, 0))
    return frames


def frames_of_sections(elf: Elf) -> dict[str, int]:
    """The same from clang's -fstack-size-section, whose table the image carries."""
    names = {s.address & ~1: s.name for s in elf.symbols if s.function and s.section}
    frames: dict[str, int] = {}
    for section in elf.sections:
        if section.name != ".stack_sizes":
            continue
        content, at = elf.content(section), 0
        while at < len(content):
            (address,) = struct.unpack_from("<I", content, at)
            at, size, shift = at + 4, 0, 0
            while True:
                byte = content[at]
                at, size, shift = at + 1, size | (byte & 127) << shift, shift + 7
                if not byte & 128:
                    break
            name = names[address & ~1]
            frames[name] = max(size, frames.get(name, 0))
    return frames


def worst(elf: Elf, frames: Mapping[str, int]) -> Stack:
    """The deepest chain of calls from the image's entry, and what the deepest exception would add to it."""
    graph = _Calls(elf)
    search = _Search(graph.calls, frames, [])
    entry = graph.name_at(elf.entry)
    chain = search.deepest(entry, ())
    reached = search.reached
    called = {callee for callees in graph.calls.values() for callee in callees}
    handlers = [search.deepest(name, ()) for name in sorted(graph.calls.keys() - reached - called)]
    above = max((EXCEPTION_FRAME + sum(frame for _, frame in calls) for calls in handlers), default=0)
    unknown = [f"{name} calls through a pointer" for name in sorted(graph.indirect)] + search.unknown
    return Stack(sum(frame for _, frame in chain), above, chain, tuple(dict.fromkeys(unknown)))


class _Search:
    """Depth first; `reached` are the functions seen so far."""

    def __init__(self, calls: Mapping[str, set[str]], frames: Mapping[str, int], unknown: list[str]) -> None:
        self._calls, self._frames, self.unknown = calls, frames, unknown
        self._known: dict[str, tuple[tuple[str, int], ...]] = {}

    @property
    def reached(self) -> set[str]:
        return set(self._known)

    def deepest(self, name: str, above: tuple[str, ...]) -> tuple[tuple[str, int], ...]:
        if name in above:
            self.unknown.append(f"{name} calls itself")
            return ()
        if name not in self._known:
            # gcc calls a copy of f that it specialised f.constprop.0 in the image and f.constprop in its report.
            spellings = (name, name.rpartition(".")[0], name.partition(".")[0])
            frame = next((self._frames[spelling] for spelling in spellings if spelling in self._frames), None)
            if frame is None:
                self.unknown.append(f"the compiler does not state the frame of {name}")
            chains = [self.deepest(callee, (*above, name)) for callee in sorted(self._calls.get(name, ()))]
            inner = max(chains, key=lambda chain: sum(size for _, size in chain), default=())
            self._known[name] = ((name, frame or 0), *inner)
        return self._known[name]


class _Calls:
    """calls: who branches to whom, tail calls included; indirect: who calls through a pointer."""

    def __init__(self, elf: Elf) -> None:
        text = {i for i, section in enumerate(elf.sections) if section.executable}
        functions = [s for s in elf.symbols if s.function and s.section in text and s.size]
        # Two names at one address are one function.
        self._functions = list(
            {s.address & ~1: s for s in sorted(functions, key=lambda s: (s.address, s.name))}.values()
        )
        self._starts = [s.address & ~1 for s in self._functions]
        self._marks = sorted((s.address, s.name[1]) for s in elf.symbols if s.name[:2] in ("$t", "$d"))
        self.calls: dict[str, set[str]] = {s.name: set() for s in self._functions}
        self.indirect: set[str] = set()
        for function in self._functions:
            section = elf.sections[function.section]
            self._scan(function, elf.content(section), section.address)

    def name_at(self, address: int) -> str:
        """The function that holds an address."""
        found = self._functions[bisect.bisect_right(self._starts, address & ~1) - 1]
        if not (found.address & ~1) <= (address & ~1) < (found.address & ~1) + found.size:
            raise ValueError(f"no function at {address:#x}")
        return found.name

    def _is_code(self, address: int) -> bool:
        at = bisect.bisect_right(self._marks, (address, "z")) - 1
        return at < 0 or self._marks[at][1] == "t"

    def _scan(self, function: Symbol, content: bytes, base: int) -> None:
        start = function.address & ~1
        flow = thumb.flow(content[start - base : start - base + function.size], start, self._is_code)
        within = range(start, start + function.size)
        targets = flow.calls | {target for target in flow.jumps if target not in within}
        for register in flow.registers:
            # Compilers put a function's address into a register where they call it often.
            known = {value & ~1 for value in flow.constants[register]} & set(self._starts)
            targets |= known
            if not known:
                self.indirect.add(function.name)
        self.calls[function.name] |= {self.name_at(target) for target in targets}

"""What halving and doubling each threshold of the diagnosis does to the verdicts of a development set."""

from __future__ import annotations

import ast
import csv
import importlib
import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from harness import SHORT, show, sized
from traced import TracedNumber, nearest
from traced import logged as flips

from runtime.diagnosis.gates import GATES
from runtime.diagnosis.stages import begin, complete, conclude
from runtime.diagnosis.steps import Trail
from runtime.diagnosis.verdict import decide
from runtime.model.loader import Model
from runtime.progress import on_cores
from runtime.recordings.recording import Recording
from runtime.simulation.options import SimulationSettings
from runtime.simulation.simulate import parse_hidden, simulate
from tests.judge import cases
from tests.judge.line import code, logged, opened

ROOMS = ("gates", "diagnosis", "identification", "regression", "motion")
BUDGET = float(os.environ.get("TENDON_BENCHMARK_BUDGET", "1500"))
"""Seconds after which nothing is begun; the table goes on where it ended, unless the code has changed."""
TABLES = Path.home() / ".cache" / "tendon" / "benchmarks"
FACTORS = (0.5, 2.0)
CHANGES = ("verdict", "named", "rivals", "failed")

CLEAN = {"clean_x10": 0.0, "clean": 0.0, "clean_jitter": 0.0}
LEFT = {"outside_wander": 1.0, "outside_knocks": 1.0, "stribeck": 0.2}
NAMED = {"ripple_direct": 0.6, "stribeck_lorentz": 1.0, "lugre": 0.5, "gravity_left_out": 0.5, "end_stop": 0.5}
"""Case and size in noise floors, as tests/judge makes them, with a development seed and its brief motion: of every kind
of effect one, and some of a size at which the gates begin to open."""
SEED = 17
SENSED = ("elasticity@1:stiffness=3000,damping=2", "backlash@1:gap=0.003,stiffness=8000,damping=4")
"""Hidden in the demo's drive, which is recorded with an encoder on the link and a torque sensor, too."""


@dataclass(frozen=True)
class Answer:
    """What a user would see change: the verdict with its reasons, what is named, and what it cannot be told from."""

    verdict: tuple[str, ...]
    named: tuple[str, ...]
    rivals: tuple[str, ...]


@dataclass(frozen=True)
class Asked:
    """A development recording, or several of one arm; what no threshold of a later room touches is computed once."""

    name: str
    model: Model
    recordings: tuple[Recording, ...]
    held_out: tuple[Recording, ...] = ()

    @cached_property
    def begun(self) -> Trail:
        return begin(self.model, self.recordings, self.held_out)

    def answer(self, room: str) -> Answer:
        """With the thresholds as they are now, of which only those of a room, and of later ones, may have changed."""
        first = room in ("gates", "diagnosis")
        trail = self.begun if first else begin(self.model, self.recordings, self.held_out)
        trail = complete(replace(trail, last=replace(trail.last)))
        found = decide(trail)
        found = conclude(trail) if found.verdict == "clean" else found
        rivals = found.findings[0].rivals if found.findings else ()
        said = (found.verdict, *(joint.why for joint in found.joints))
        return Answer(said, tuple(str(f.term) for f in found.findings), tuple(map(str, rivals)))


def judged(name: str, size: float, joints: int = 1, heard: bool = False, drive: str = "") -> Asked:
    """A case; heard: with a recording that is not fitted; drive: told what to make, in place of a recorded torque."""
    of_name = cases.cases([name], [joints], [size], [SEED], cases.Setting())
    case = next(c for c in of_name if c.label == name)
    made = logged(cases.make(replace(case, setting=replace(case.setting, excitation="brief", drive=drive))))
    label = f"{name} {joints}R {size:g} {drive}{'held out' if heard else ''}".rstrip()
    held_out = (made.held_out,) if heard else ()
    return Asked(label, opened(made.model).compiled.model(), (made.recording,), held_out)


def sensed(hidden: str) -> Asked:
    model = opened(
        (Path(__file__).parents[2] / "symbolic/arms/drive.toml").read_text(encoding="utf-8")
    ).compiled.model()
    made, _ = simulate(
        model, [parse_hidden(hidden, model)], SimulationSettings(SEED, seconds=10.0, signals="q_link,tau_link")
    )
    return Asked(f"{hidden.partition('@')[0]} sensed", model, (made,))


def turned() -> Asked:
    """A torque of the wrong sign."""
    asked = judged("clean", 0.0)
    return replace(asked, name="wrong sign", recordings=tuple(r.with_torques(-r.tau) for r in asked.recordings))


def different() -> Asked:
    """Two recordings of two arms, which a user took for one."""
    a, b = judged("clean", 0.0), judged("stribeck", 1.5)
    return Asked("two arms", a.model, (*a.recordings, *b.recordings))


def development_set() -> list[Callable[[], Asked]]:
    """Makers of recordings, what costs least first."""
    sets: list[Callable[[], Asked]] = [partial(judged, *case) for case in (*CLEAN.items(), *LEFT.items())]
    sets += [turned, partial(judged, "clean", 0.0, drive="servo_open"), partial(judged, "stribeck", 0.4, heard=True)]
    sets += [*(partial(judged, *case) for case in NAMED.items()), partial(judged, "payload", 0.6, joints=2), different]
    return [*sets, *(partial(sensed, s) for s in SENSED), partial(judged, "coupled_gear", 0.6, joints=2, heard=True)]


def settings(room: str) -> dict[str, Any]:
    """Name -> value of a room's thresholds but those that decide no verdict by their own word, or of the gates."""
    if room == "gates":
        return {f"gate {gate.name}": gate.limit for gate in GATES if gate.limit}
    module = importlib.import_module(f"runtime.{room}.settings")
    body = ast.parse(Path(str(module.__file__)).read_text(encoding="utf-8")).body
    found = {}
    for node, text in pairwise(body):
        if isinstance(node, ast.AnnAssign) and "decides no" not in ast.unparse(text):
            name = ast.unparse(node.target)
            found[name] = getattr(module, name)
    return found


def scaled(value: Any, factor: float) -> Any:
    if isinstance(value, dict):
        return {k: scaled(v, factor) for k, v in value.items()}
    if isinstance(value, tuple):
        return tuple(scaled(v, factor) for v in value)
    return max(1, round(value * factor)) if isinstance(value, int) else value * factor


@contextmanager
def put(name: str, value: Any) -> Iterator[None]:
    """The threshold at another value wherever it is read."""
    gates = [gate for gate in GATES if f"gate {gate.name}" == name]
    readers = [vars(m) for key, m in sys.modules.items() if key.startswith("runtime.") and name in vars(m)]
    before, limits = [reader[name] for reader in readers], [gate.limit for gate in gates]
    try:
        for reader in readers:
            reader[name] = value
        for gate in gates:
            object.__setattr__(gate, "limit", value)
        yield
    finally:
        for reader, old in zip(readers, before, strict=True):
            reader[name] = old
        for gate, limit in zip(gates, limits, strict=True):
            object.__setattr__(gate, "limit", limit)


def margins(asked: Asked) -> dict[str, float]:
    """By threshold, the factor nearest to 1 at which a comparison with it flips on a recording; NaN where that is not
    known of one that is read. Those that are not read, and gates that are not asked, are left out."""
    log, called = flips(), set()
    whole = {name: value for room in ROOMS for name, value in settings(room).items()}
    with ExitStack() as changed:
        for name, value in whole.items():
            if isinstance(value, float):
                changed.enter_context(put(name, TracedNumber.of(value, name, log)))
        sys.setprofile(lambda frame, *_: called.add(frame.f_code))
        try:
            asked.answer("motion")
        finally:
            sys.setprofile(None)
    read = {name for function in called for name in function.co_names}
    return {name: nearest(log[name]) if name in log else float("nan") for name in whole if name in log or name in read}


def outcome(asked: Asked, room: str, name: str, value: Any, usual: Answer) -> str:
    """ "" for the usual answer, "verdict", "name" or "rivals" for what is another, "failed" for none at all."""
    with put(name, value):
        try:
            found = asked.answer(room)
        except Exception:
            return "failed"
    for what in ("verdict", "named", "rivals"):
        if getattr(found, what) != getattr(usual, what):
            return what
    return ""


Row = tuple[str, str, str, str, str]
"""Recording, threshold, factor, margin, outcome."""


def measure(asked: Asked, todo: Sequence[tuple[str, str, float]], until: float) -> Iterator[Row]:
    near = margins(asked) if todo else {}
    usual: dict[str, Answer] = {}
    for room, name, factor in todo:
        if time.monotonic() > until:
            return
        margin = near.get(name)
        # A comparison that flips farther away is not touched.
        if margin is not None and (np.isnan(margin) or min(1.0, factor) <= margin <= max(1.0, factor)):
            if room not in usual:
                usual[room] = asked.answer(room)
            found = outcome(asked, room, name, scaled(settings(room)[name], factor), usual[room])
        else:
            found = "unread" if margin is None else ""
        yield asked.name, name, f"{factor:g}", "" if margin is None else f"{margin:.3g}", found


def test_thresholds() -> None:
    """Asserted is that a threshold out of reach silences every recording: that a change arrives where it is read."""
    every = [(room, name, factor) for room in ROOMS for name in settings(room) for factor in FACTORS]
    todo = every[:: sized(1, len(every) // 8)]
    path = TABLES / f"thresholds-{code()}{'-short' if SHORT else ''}.csv"
    path.parent.mkdir(parents=True, exist_ok=True)
    rows = [tuple(r) for r in csv.reader(path.open())] if path.exists() and not SHORT else []
    until = time.monotonic() + BUDGET
    with on_cores(1):  # what another process compares is not logged here
        for make in development_set()[: sized(None, 2)]:
            if time.monotonic() > until:
                break
            asked = make()
            shown = {(name, factor) for where, name, factor, _, what in rows if what in CHANGES or where == asked.name}
            left = [(r, n, f) for r, n, f in todo if (n, f"{f:g}") not in shown]
            print(f"{asked.name}: {asked.answer('diagnosis')}, {len(left)} changes to try", flush=True)
            with put("LEAST_PRICE", float("inf")):
                assert asked.answer("diagnosis").named == ()
            with path.open("a", newline="") as file:
                for row in measure(asked, left, until):
                    csv.writer(file).writerow(row)
                    file.flush()
                    rows.append(row)
    table(rows)


def table(rows: Sequence[Sequence[str]]) -> None:
    """A row a threshold: on how many recordings it is read and compares within a factor of two, of those that were
    asked, and what changes first as it is halved and doubled."""
    tried = list(dict.fromkeys(where for where, *_ in rows))
    lines = []
    for room in ROOMS:
        for name, value in settings(room).items():
            own = [row[:1] + row[2:] for row in map(tuple, rows) if row[1] == name]
            read = {where: margin for where, _, margin, what in own if what != "unread"}
            cells = [f"{sum(map(_within, read.values()))} of {len(read)}"]
            for factor in FACTORS:
                found = [f"{what}: {where}" for where, f, _, what in own if f == f"{factor:g}" and what in CHANGES]
                cells.append(", ".join(found) or "-")
            if own:
                lines.append([f"{room}: {name}", str(value), *cells])
    notes = [
        f"{len(tried)} recordings: {', '.join(tried)}",
        "binds: recordings with a comparison within a factor of two, or read otherwise, of those that read it",
    ]
    show("Thresholds, halved and doubled", ["threshold", "value", "binds", "halved", "doubled"], lines, notes)


def _within(margin: str) -> bool:
    factor = float(margin or "inf")
    return bool(np.isnan(factor)) or FACTORS[0] <= factor <= FACTORS[1]

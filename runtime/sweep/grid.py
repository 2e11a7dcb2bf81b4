"""Variations of one scenario as data: `cycle_time=1.0:3.0:0.2` times `case=A,B,C,D`, and the jobs that follow."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import product
from math import floor, isfinite, prod

from runtime.model.loader import Model
from runtime.planning import scenario_file
from runtime.planning.scenario import Declared, Scenario, SoughtSpring, SpringPlan, sought, springs
from runtime.planning.settings import LONGEST_CYCLE, SHORTEST_CYCLE
from runtime.sweep.job import Code, Job, Value, digest
from symbolic.model_file.checks import Names, did_you_mean, joint_number, known_joints, printable, quote

CASES = {"A": (False, False), "B": (False, True), "C": (True, False), "D": (True, True)}
"""The paper's: with friction, with springs."""
MAX_JOBS = 1_000_000
_ONE_SPRING = re.compile(r"([a-z][a-z0-9_]*)(?:@([1-9]\d?))?")
_CONTACT = re.compile(r"(\w+)\.(\w+)", re.ASCII)
_ALWAYS = ("cycle_time", "case", "seed")
_DIGITS = 12
"""Of a number in a range: 1.0 + 2 · 0.1 is meant to be 1.2."""


class GridError(ValueError):
    """A grid that cannot be meant; the message says what to write."""


@dataclass(frozen=True)
class Variation:
    """What varies, and its values in order: numbers; letters for `case`; whole numbers for `seed`."""

    name: str
    values: tuple[Value, ...]


def parse(texts: Sequence[str], effects: Declared, joints: Names = ()) -> tuple[Variation, ...]:
    """The axes of `--over NAME=VALUES`, VALUES as `1.0,1.2` or `1.0:3.0:0.2`.

    effects   of the library, by name     joints   what the arm's are called; an axis has their numbers
    Raises GridError.
    """
    axes = tuple(_axis(text, effects, joints) for text in texts)
    names = [axis.name for axis in axes]
    for name in names:
        if names.count(name) > 1:
            raise GridError(f"--over {name}: given twice; give all its values at once, {name}=1,2,3")
        bare, at, _ = name.partition("@")
        if at and bare in names:
            raise GridError(f"--over {name}: {bare} of all springs varies already; give a joint to each, or to none")
    return axes


def _axis(text: str, effects: Declared, joints: Names) -> Variation:
    name, equals, values = (part.strip() for part in text.partition("="))
    where = f"--over {printable(text)}"
    if not equals or not name or not values:
        raise GridError(f"{where}: expected NAME=VALUES, such as cycle_time=1.0,1.2 or cycle_time=1.0:3.0:0.2")
    spring = _ONE_SPRING.fullmatch(name)
    what, at, called = name.partition("@")
    if at and joints and spring is None:
        if (number := joint_number(called, joints)) is None:
            raise GridError(f"{where}: there is no joint {quote(called)}; expected {known_joints(joints)}")
        name = f"{what}@{number}"
        spring = _ONE_SPRING.fullmatch(name)
    able = {p.name: p for info in springs(effects).values() for p in info.parameters if p.planned}
    if name not in _ALWAYS and not (spring and spring[1] in able) and not _CONTACT.fullmatch(name):
        known = [*_ALWAYS, *(name for what in able for name in (what, f"{what}@1"))]
        touched = [f"{e.name}.{e.parameters[0].name}" for e in effects.values() if e.brought and e.scope == "contact"]
        raise GridError(f"{where}: nothing is called {quote(name)}; {did_you_mean(name, (*known, *touched[:1]))}")
    items = [item.strip() for item in values.split(",")]
    if name == "case":
        unknown = [item for item in items if item not in CASES]
        if unknown:
            raise GridError(f"{where}: there is no case {quote(unknown[0])}; expected some of {', '.join(CASES)}")
        return Variation(name, tuple(dict.fromkeys(items)))
    numbers = [x for item in items for x in _numbers(where, item, name == "seed")]
    for x in numbers:
        if name == "seed" and (x != int(x) or x < 0):
            raise GridError(f"{where}: {x:g} is no seed; expected whole numbers from 0 on")
        if name == "cycle_time" and not SHORTEST_CYCLE <= x <= LONGEST_CYCLE:
            raise GridError(f"{where}: {x:g} s is no cycle time; expected {SHORTEST_CYCLE:g} to {LONGEST_CYCLE:g} s")
        if spring and name not in _ALWAYS and x < (least := able[spring[1]].bounds[0]):
            unit = able[spring[1]].unit.text()
            raise GridError(
                f"{where}: {x:g} {unit} is no {spring[1]}; expected {least:g} or more (no spring: case=A,C)"
            )
    return Variation(name, tuple(int(x) if name == "seed" else x for x in dict.fromkeys(numbers)))


def _numbers(where: str, item: str, whole: bool) -> list[float]:
    """A number, or a range START:END:STEP with both ends in it; the step of whole numbers may be left out."""
    parts = item.split(":")
    try:
        bounds = [float(part) for part in parts]
    except ValueError:
        bounds = []
    if not bounds or not all(map(isfinite, bounds)):
        raise GridError(f"{where}: {quote(item)} is no number and no range; expected 1.2 or START:END:STEP")
    if len(bounds) == 1:
        return bounds
    if len(bounds) == 2 and whole:
        bounds.append(1.0)
    if len(bounds) != 3:
        raise GridError(f"{where}: {quote(item)} is no range; expected START:END:STEP")
    start, end, step = bounds
    if step <= 0 or end < start:
        raise GridError(f"{where}: {quote(item)} is an empty range; expected START <= END and STEP > 0")
    steps = (end - start) / step * (1 + 1e-9) + 1e-9
    if not steps < MAX_JOBS:
        raise GridError(f"{where}: {quote(item)} has {steps:.6g} values; expected at most {MAX_JOBS}")
    count = floor(steps) + 1
    return [float(f"{start + k * step:.{_DIGITS}g}") for k in range(count)]


# --- variations ---


def jobs(scenario: Scenario, axes: Sequence[Variation], model: Model, code: Code, starts: int | None) -> list[Job]:
    """Every variation with every seed, each once, in the order of the axes. Raises GridError, ModelError.

    starts   random first guesses within one job; None: as many as optimize() takes by itself
    """
    seeds = next((axis.values for axis in axes if axis.name == "seed"), (0,))
    over = [axis for axis in axes if axis.name != "seed"]
    count = prod(len(axis.values) for axis in over) * len(seeds)
    if count > MAX_JOBS:
        raise GridError(f"--over: {count} jobs; expected at most {MAX_JOBS}: fewer values, or several tables")
    arm = code.identity()
    found: dict[str, Job] = {}
    for values in product(*(axis.values for axis in over)):
        columns, varied = _varied(scenario, model, dict(zip((axis.name for axis in over), values, strict=True)))
        fitted = scenario_file.fitted(varied, model, "--over")
        for seed in seeds:
            key = digest([arm, columns, asdict(fitted), int(seed), starts])
            found.setdefault(key, Job(columns, fitted, int(seed), starts=starts, key=key))
    return list(found.values())


def _varied(scenario: Scenario, model: Model, setting: Mapping[str, Value]) -> tuple[dict[str, Value | None], Scenario]:
    """The columns of a variation, and its scenario. A column is blank where the case leaves out what it is about."""
    columns: dict[str, Value | None] = dict(setting)
    if "case" in setting:
        letter = str(setting["case"])
        friction, sprung = CASES[letter]
        if sprung and not scenario.springs:
            raise GridError(f"--over case={letter}: the scenario has no [[spring]]; cases B and D need one")
        scenario = replace(scenario if sprung else scenario.without_springs(), friction=friction)
    for name, value in setting.items():
        if name not in _ALWAYS and (spring := _ONE_SPRING.fullmatch(name)):
            if not scenario.springs and "case" in setting:
                columns[name] = None
                continue
            scenario = _sprung(scenario, model, name, what=spring[1], joint=spring[2], value=float(value))
        elif contact := _CONTACT.fullmatch(name):
            effect, key = contact.groups()
            own = {**scenario.contact.get(effect, {}), key: float(value)}
            scenario = replace(scenario, contact={**scenario.contact, effect: own})
        elif name == "cycle_time":
            scenario = scenario.at(float(value))
    return columns, scenario


def _sprung(scenario: Scenario, model: Model, name: str, what: str, joint: str | None, value: float) -> Scenario:
    """With a parameter given that is sought of springs, at one joint or at all that have such a spring."""
    own = sought(model, scenario)
    there = [spring.plan.joint for spring in own if what in spring.plan.sought]
    if not there or (joint is not None and int(joint) not in there):
        known = f"it has springs at joint {', '.join(map(str, there))}" if there else "it has no [[spring]]"
        raise GridError(f"--over {name}: the scenario has no such spring; {known}")
    chosen = {int(joint)} if joint is not None else set(there)

    def held(spring: SoughtSpring) -> SpringPlan:
        plan = spring.plan.within(what, value, value)
        return replace(plan, catalogue=()) if what == spring.size.name else plan

    return replace(scenario, springs=tuple(held(s) if s.plan.joint in chosen else s.plan for s in own))

"""The scenario file: TOML in, a checked Scenario out. Every error is one line that says where and what to do."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from dataclasses import replace
from math import isclose
from pathlib import Path
from typing import Any, get_args

from runtime.model.loader import Model
from runtime.model.terms import SURFACE, Term, giver
from runtime.planning.scenario import Goal, Kind, Objective, PhasePlan, Point, Scenario, SpringPlan, Values
from runtime.planning.springs import springs, usual
from symbolic.model_file.checks import (
    Place,
    did_you_mean,
    found,
    identifier,
    keys,
    number,
    pair,
    printable,
    quote,
    table_at,
)

MAX_DEGREE = 20
_OF_A_SPRING = ("joint", "effect", "catalogue")
"""Keys of [[spring]] beside its parameters."""
CLOSE = 1e-6  # m


def read(path: Path) -> Scenario:
    """The scenario in a TOML file, as far as it can be checked without the arm. Raises ModelError."""
    top = Place(printable(str(path)))
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        top.fail("no such file; expected a scenario in TOML")
    except (OSError, UnicodeDecodeError) as error:
        top.fail(f"cannot be read: {printable(str(error))}")
    except (tomllib.TOMLDecodeError, RecursionError, ValueError) as error:
        top.fail(f"not valid TOML: {printable(str(error))}")
    return parse(table, top)


def parse(table: Mapping[str, Any], top: Place) -> Scenario:
    """The scenario that a TOML document describes. Raises ModelError."""
    optional = ("periodic", "friction", "elbow", "moving", "posture", "objective", "spring", "contact", "ranges")
    keys(top, table, ("name", "model", "cycle_time", "points", "phase"), optional)
    points = {
        identifier(top.inside("points"), "name", name): _point(top.inside(f"points.{name}"), value)
        for name, value in table_at(top.inside("points"), table["points"], "[points.NAME], one a point").items()
    }
    elbow = number(top, "elbow", table.get("elbow", 1), "")
    if elbow not in (1.0, -1.0):
        top.fail(f"elbow is {elbow:g}; expected 1 or -1, the sign of sin q_2 in contact")
    scenario = Scenario(
        name=identifier(top, "name", table["name"]),
        model=_text(top, "model", table["model"]),
        cycle_time=number(top, "cycle_time", table["cycle_time"], "s", positive=True),
        periodic=_flag(top, "periodic", table.get("periodic", True)),
        friction=_flag(top, "friction", table.get("friction", True)),
        moving=_joints(top, "moving", table.get("moving", [])),
        posture=tuple(number(top, "posture", q, "rad or m") for q in _list(top, "posture", table.get("posture", []))),
        objective=_objective(top.inside("objective"), table.get("objective", {})),
        points=points,
        phases=tuple(
            _phase(top.inside(f"phase {k}"), value, points)
            for k, value in enumerate(_list(top, "phase", table["phase"]), 1)
        ),
        springs=tuple(
            _spring(top.inside(f"spring {k}"), value)
            for k, value in enumerate(_list(top, "spring", table.get("spring", [])), 1)
        ),
        contact={
            name: _values(top.inside(f"contact.{name}"), values)
            for name, values in table_at(top.inside("contact"), table.get("contact", {}), "[contact.plate]").items()
        },
        elbow=elbow,
        ranges=_ranges(top.inside("ranges"), table.get("ranges", {})),
    )
    _check_order(top, scenario)
    return scenario


# --- parts ---


def _point(place: Place, value: Any) -> Point:
    table = table_at(place, value, "with q1, q2, ... or tip, and rest or tip_rest")
    joints = {key: int(key[1:]) for key in table if re.fullmatch(r"q[1-9]\d?", key)}
    keys(place, {k: v for k, v in table.items() if k not in joints}, (), ("tip", "rest", "tip_rest"))
    return Point(
        q={joint: number(place, key, table[key], "rad or m") for key, joint in joints.items()},
        tip=pair(place, "tip", table["tip"], "m") if "tip" in table else None,
        rest=_flag(place, "rest", table.get("rest", False)),
        tip_rest=_flag(place, "tip_rest", table.get("tip_rest", False)),
    )


def _phase(place: Place, value: Any, points: Mapping[str, Point]) -> PhasePlan:
    table = table_at(place, value, "with from, to, part and degree")
    keys(place, table, ("from", "to", "part", "degree"), ("kind", "monotone"))
    for key in ("from", "to"):
        name = _text(place, key, table[key])
        if name not in points:
            place.fail(f"{key} is the unknown point {quote(name)}; {did_you_mean(name, tuple(points))}")
    kind = table.get("kind", "free")
    if kind not in get_args(Kind):
        place.fail(f'kind is {found(kind)}; expected "free" or "contact"')
    degree = number(place, "degree", table["degree"], "", 3, MAX_DEGREE)
    if degree != int(degree):
        place.fail(f"degree is {degree:g}; expected a whole number")
    part = number(place, "part", table["part"], "of the cycle time", 0.0, 1.0, positive=True)
    monotone = _flag(place, "monotone", table.get("monotone", False))
    return PhasePlan(table["from"], table["to"], kind, part, int(degree), monotone)


def _spring(place: Place, value: Any) -> SpringPlan:
    table = table_at(place, value, "with a joint and the spring's parameters")
    if "joint" not in table:
        place.fail("joint is missing")
    (joint,) = _joints(place, "joint", [table["joint"]])
    items = _list(place, "catalogue", table.get("catalogue", []))
    catalogue = tuple(sorted(number(place, "catalogue", k, "SI units", positive=True) for k in items))
    stated = {key: _range(place, key, x, "SI units") for key, x in table.items() if key not in _OF_A_SPRING}
    return SpringPlan(joint, stated, {}, catalogue, _text(place, "effect", table.get("effect", "")))


def _objective(place: Place, value: Any) -> Objective:
    table = table_at(place, value, "with goal")
    keys(place, table, (), ("goal", "joints", "resistance"))
    goal = table.get("goal", "torque_squared")
    if goal not in get_args(Goal):
        place.fail(f"goal is {found(goal)}; expected one of {', '.join(get_args(Goal))}")
    resistance = _list(place, "resistance", table.get("resistance", []))
    return Objective(
        goal=goal,
        joints=_joints(place, "joints", table.get("joints", [])),
        resistance={i: number(place, "resistance", r, "Ohm", positive=True) for i, r in enumerate(resistance, 1)},
    )


def _check_order(top: Place, scenario: Scenario) -> None:
    if not scenario.phases:
        top.fail("no [[phase]]; expected at least one")
    total = sum(phase.part for phase in scenario.phases)
    if not isclose(total, 1.0, abs_tol=1e-6):
        top.fail(f"the phases' parts add up to {total:g}; expected 1")
    after = (*scenario.phases[1:], scenario.phases[0])
    for k, (phase, following) in enumerate(zip(scenario.phases, after, strict=True), 1):
        if phase.end != following.start and (scenario.periodic or k < len(scenario.phases)):
            top.inside(f"phase {k}").fail(f'ends at "{phase.end}", and the next one begins at "{following.start}"')
    if len({s.joint for s in scenario.springs}) < len(scenario.springs):
        top.fail("two [[spring]] tables for one joint; expected at most one")


def _ranges(place: Place, value: Any) -> dict[int, tuple[float, float]]:
    table = table_at(place, value, "with q1 = [from, to], q2, ... of joints that stay within less than their limits")
    found = {}
    for key, ends in table.items():
        if not re.fullmatch(r"q[1-9]\d?", key):
            place.fail(f"unknown key {quote(key)}; expected q1, q2, ...")
        low, high = pair(place, key, ends, "rad or m")
        if low >= high:
            place.fail(f"{key} is [{low:g}, {high:g}]; expected the smaller end first")
        found[int(key[1:])] = (low, high)
    return found


# --- with the arm ---


def fitted(scenario: Scenario, model: Model, where: str) -> Scenario:
    """The scenario for this arm: joints exist, the contact is there, defaults are filled in. Raises ModelError."""
    top = Place(printable(where))
    n = model.n

    full = replace(
        scenario,
        springs=tuple(
            _declared(top.inside(f"spring {k}"), s, model) for k, s in enumerate(scenario.springs, 1) if s.joint <= n
        )
        + tuple(s for s in scenario.springs if s.joint > n),
        moving=scenario.moving or tuple(range(1, n + 1)),
        posture=scenario.posture or (0.0,) * n,
    )
    if len(full.posture) != n:
        top.fail(f"posture has {len(full.posture)} numbers; {model.name} has {n} joints")
    named = {"moving": full.moving, "objective: joints": full.objective.joints}
    named |= {f"points.{name}": tuple(point.q) for name, point in full.points.items()}
    named |= {"ranges": tuple(full.ranges)}
    named |= {"spring": tuple(s.joint for s in full.springs)}
    for name, joints in named.items():
        for joint in joints:
            if joint > n:
                top.inside(name).fail(f"there is no joint {joint}; {model.name} has {n}")
    for name, point in full.points.items():
        still = [j for j in point.q if j not in full.moving and point.q[j] != full.posture[j - 1]]
        if still:
            top.inside(f"points.{name}").fail(
                f"joint {still[0]} does not move; add it to moving, or leave out q{still[0]}"
            )
        _check_range(top.inside(f"points.{name}"), point, model)
    _check_electrical(top, full, model)
    _check_contact(top, full, model)
    return full


def _declared(place: Place, spring: SpringPlan, model: Model) -> SpringPlan:
    """The spring with what is sought apart from what is stated, by its declaration."""
    known = springs(model.library.effects)
    if spring.effect and spring.effect not in known:
        place.fail(f"effect is {quote(spring.effect)}; expected one of {', '.join(known)}")
    info = known[spring.effect or usual(known)]
    kind = model.joints[spring.joint - 1].type
    optional = tuple(p.name for p in info.linear if not p.planned)
    written = {**{name: (x, x) for name, x in spring.stated.items()}, **spring.sought}
    keys(place, written, tuple(p.name for p in info.parameters if p.name not in optional), optional)
    sought, stated = {}, {}
    for p in info.parameters:
        low, high = written.get(p.name, (p.neutral, p.neutral))
        least, most = p.bounds
        if low < least or high > most or (p.role == "given" and low == least):
            unit = p.unit.text(kind)
            expected = f"{least:g} {unit} or more" if low <= least else f"at most {most:g} {unit}"
            place.fail(f"{p.name} is {low if low <= least else high:g}; expected {expected}")
        if p.planned:
            sought[p.name] = (low, high)
        elif low != high:
            place.fail(f"{p.name} is [{low:g}, {high:g}]; expected one number: it is not sought")
        else:
            stated[p.name] = low
    return replace(spring, sought=sought, stated=stated)


def _check_range(place: Place, point: Point, model: Model) -> None:
    for which, q in point.q.items():
        joint = model.joints[which - 1]
        low, high = joint.position_limits or (q, q)
        if not low <= q <= high:
            unit = joint.position_unit
            place.fail(f"q{which} is {q:g} {unit}; joint {which} can go from {low:g} to {high:g} {unit}")


def _check_electrical(top: Place, scenario: Scenario, model: Model) -> None:
    if scenario.objective.goal != "electrical_energy":
        return
    place = top.inside("objective")
    if len(scenario.objective.resistance) != model.n:
        place.fail(
            f"resistance has {len(scenario.objective.resistance)} numbers; expected {model.n}, one a joint, in Ohm"
        )
    for joint in scenario.objective.joints or scenario.moving:
        if model.joints[joint - 1].torque_constant is None:
            place.fail(f"electrical_energy needs the torque_constant of joint {joint} in the model file")


def _check_contact(top: Place, scenario: Scenario, model: Model) -> None:
    for name, values in scenario.contact.items():
        place = top.inside(f"contact.{name}")
        info = model.library.effects.get(name)
        if model.contact is None or name not in model.contact["effects"] or info is None:
            known = tuple(model.contact["effects"]) if model.contact else ()
            place.fail(
                f"{model.name} has no such effect at its contact" + (f"; it has {', '.join(known)}" if known else "")
            )
        parameters = tuple(p.name for p in info.parameters)
        for key in values:
            if key not in parameters:
                place.fail(f"unknown parameter {quote(key)}; {did_you_mean(key, parameters)}")
    touching = [(k, p) for k, p in enumerate(scenario.phases, 1) if p.kind == "contact"]
    if not touching:
        return
    touched = model.contact and giver(model.library, map(Term, model.contact["effects"]), SURFACE)
    if "contact_inverse" not in model.functions or model.contact is None or not touched:
        top.inside(f"phase {touching[0][0]}").fail(
            f"a contact phase needs an arm of four revolute joints with a [contact] and its plate; {model.name} is none"
        )
    if scenario.moving != tuple(range(1, model.n + 1)):
        top.inside("moving").fail("in a contact phase all joints move; leave moving out")
    x = float(model.contact["x"])
    for k, phase in touching:
        for name in (phase.start, phase.end):
            tip = scenario.points[name].tip
            if tip is None:
                top.inside(f"points.{name}").fail(f"contact phase {k} begins or ends here; expected a tip")
            if abs(tip[0] - x) > CLOSE:
                top.inside(f"points.{name}").fail(f"tip has x = {tip[0]:g} m; in contact it is the plate's, {x:g} m")


# --- values ---


def _text(place: Place, key: str, value: Any) -> str:
    if not isinstance(value, str):
        place.fail(f"{key} is {found(value)}; expected a text")
    return value


def _flag(place: Place, key: str, value: Any) -> bool:
    if not isinstance(value, bool):
        place.fail(f"{key} is {found(value)}; expected true or false")
    return value


def _list(place: Place, key: str, value: Any) -> list[Any]:
    if not isinstance(value, list):
        place.fail(f"{key} is {found(value)}; expected a list")
    return value


def _joints(place: Place, key: str, value: Any) -> tuple[int, ...]:
    items = _list(place, key, value)
    for item in items:
        if isinstance(item, bool) or not isinstance(item, int) or item < 1:
            place.fail(f"{key} holds {found(item)}; expected joints, counted from 1")
    if len(set(items)) < len(items):
        place.fail(f"{key} names a joint twice")
    return tuple(sorted(items))


def _range(place: Place, key: str, value: Any, unit: str) -> tuple[float, float]:
    """Two bounds, or one number that is both."""
    if not isinstance(value, list):
        return (number(place, key, value, unit),) * 2
    low, high = pair(place, key, value, unit)
    if low > high:
        place.fail(f"{key} is [{low:g}, {high:g}]; expected the smaller bound first")
    return low, high


def _values(place: Place, value: Any) -> Values:
    return {key: number(place, key, x, "SI units") for key, x in table_at(place, value, "of parameters").items()}

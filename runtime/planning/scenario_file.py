"""The scenario file in TOML, checked. An error is one line that says where it is and what to do."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import isclose
from pathlib import Path
from typing import Any, get_args

from runtime.model.loader import Model
from runtime.model.terms import SURFACE, Term, giver
from runtime.planning.scenario import (
    Goal,
    Kind,
    Objective,
    PhasePlan,
    Point,
    Scenario,
    SpringPlan,
    springs,
    usual,
)
from runtime.planning.settings import LONGEST_CYCLE, SHORTEST_CYCLE
from symbolic.model_file import checks
from symbolic.model_file.checks import Place, did_you_mean, number, parse_toml, printable, quote, table_at, unknown
from symbolic.model_file.fields import (
    Bounds,
    Choice,
    FieldRow,
    Flag,
    Inner,
    Interval,
    JointNumbers,
    Name,
    Named,
    Number,
    Numbers,
    OpenTable,
    Others,
    PerJoint,
    Several,
    Text,
    Whole,
    WholeNumber,
    rows,
)
from symbolic.model_file.fields import (
    read as read_fields,
)

MAX_DEGREE = 20
_OF_A_SPRING = ("joint", "effect", "catalogue")
"""Keys of [[spring]] that are not parameters of the effect."""
_CLOSE = 1e-6
"""m; tolerance of the plate's x."""


def read(path: Path) -> Scenario:
    """The scenario in a TOML file, as far as it can be checked without the arm. Raises ModelError."""
    top = Place(printable(str(path)))
    text = checks.read_text(path, checks.MAX_BYTES, "a scenario in TOML")
    return parse(parse_toml(text, top), top)


# --- keys ---

_GOALS, _KINDS = get_args(Goal), get_args(Kind)
_MANY = 10_000

POINT = (
    PerJoint("q1", "position of joint 1, likewise q2, ...; default: free", Number, unit="rad or m", default=None),
    Numbers("tip", "place of the end-effector: base x and y, in space x, y and z; default: free", unit="m", default=()),
    Numbers(
        "pointing", "in space: direction of the z axis of the tip's frame, in base axes; default: free", default=()
    ),
    Numbers(
        "orientation",
        "in space: roll, pitch, yaw of the tip's frame, as in URDF; default: free",
        unit="rad",
        default=(),
    ),
    Flag("rest", "whether all joints stand still", default=False),
    Flag("tip_rest", "whether the end-effector stands still; joints may move", default=False),
)
PHASE = (
    Text("from", "the point where the phase begins"),
    Text("to", "the point where it ends"),
    Choice("kind", "free: joint coordinates; contact: those of (13)", _KINDS, '"free" or "contact"', default="free"),
    Number("part", "fraction of the cycle; all parts add up to 1", unit="of the cycle time", high=1.0, positive=True),
    WholeNumber("degree", "degree of the polynomials, M of (9)", low=3, high=MAX_DEGREE),
    Flag("monotone", "whether no joint turns back between two stated positions", default=False),
)
SPRING = (
    Whole(
        "joint",
        "joint where it is mounted, counted from 1; one spring per joint",
        low=1,
        high=_MANY,
        expected="a joint, counted from 1",
    ),
    Text("effect", "effect of the spring; default: the first of the library", default=""),
    Numbers("catalogue", "stiffnesses that can be bought; default: any", positive=True, default=()),
    Others(
        "PARAMETER",
        "parameter of the spring: a number, or two bounds if it is optimized",
        Bounds,
        _OF_A_SPRING,
        unit="SI units",
        default=None,
    ),
)
OBJECTIVE = (
    Choice("goal", ", ".join(_GOALS), _GOALS, f"one of {', '.join(_GOALS)}", default=_GOALS[0]),
    JointNumbers("joints", "joints whose torque counts; default: those that move", default=()),
    Numbers(
        "resistance", "resistance of each joint's motor, for electrical_energy", unit="Ohm", positive=True, default=()
    ),
)
RANGES = (PerJoint("q1", "range of joint 1, likewise q2, ...", Interval, unit="rad or m", default=None),)
SCENARIO = (
    Name("name", "name of the scenario: a C identifier"),
    Text("model", "model file beside this one, or the name of an arm of the toolkit"),
    Number("cycle_time", "duration of the motion", SHORTEST_CYCLE, LONGEST_CYCLE, unit="s"),
    Flag("periodic", "whether the last point is the first", default=True),
    Flag("friction", "whether the motion is planned with the model's friction", default=True),
    JointNumbers("moving", "joints that move, counted from 1; default: all", default=()),
    Numbers("posture", "positions of all joints, for those that do not move; default: 0", unit="rad or m", default=()),
    Inner("objective", "what is minimized", OBJECTIVE, default={}),
    Named("points", "instants between two phases", POINT),
    Several("phase", "one after another", PHASE),
    Several("spring", "parallel springs that are optimized together with the motion", SPRING, default=()),
    OpenTable(
        "contact",
        "parameters of the contact's effects in place of the model file's",
        "EFFECT.PARAMETER",
        "[contact.plate]",
        unit="SI units",
        default={},
    ),
    Choice("elbow", "sign of sin q_2 in contact", (1.0, -1.0), "1 or -1, the sign of sin q_2 in contact", default=1.0),
    Inner("ranges", "narrower than the joints' limits", RANGES, default={}),
)


def scenario_file_rows() -> list[FieldRow]:
    """Every key of the scenario file, with unit, meaning and default, for a guide."""
    return rows(SCENARIO)


# --- the file by itself ---


def parse(table: Mapping[str, Any], top: Place) -> Scenario:
    """The scenario that a TOML document describes. Raises ModelError."""
    given = read_fields(top, table, SCENARIO)
    objective = given["objective"]
    scenario = Scenario(
        name=given["name"],
        model=given["model"],
        cycle_time=given["cycle_time"],
        periodic=given["periodic"],
        friction=given["friction"],
        moving=given["moving"],
        posture=given["posture"],
        objective=Objective(**{**objective, "resistance": dict(enumerate(objective["resistance"], 1))}),
        points={name: _point(top.inside(f"points.{name}"), p) for name, p in given["points"].items()},
        phases=tuple(_phase(top.inside(f"phase {k}"), p, given["points"]) for k, p in enumerate(given["phase"], 1)),
        springs=tuple(
            SpringPlan(s["joint"], s["PARAMETER"], catalogue=tuple(sorted(s["catalogue"])), effect=s["effect"])
            for s in given["spring"]
        ),
        contact={name: _values(top.inside(f"contact.{name}"), values) for name, values in given["contact"].items()},
        elbow=given["elbow"],
        ranges=given["ranges"]["q1"],
    )
    _check_order(top, scenario)
    return scenario


def _point(place: Place, given: Mapping[str, Any]) -> Point:
    for key, expected in (("pointing", "x, y and z"), ("orientation", "roll, pitch and yaw")):
        if given[key] and len(given[key]) != 3:
            place.fail(f"{key} has {len(given[key])} numbers; expected three: {expected}")
    if given["pointing"] and given["orientation"]:
        place.fail("pointing and orientation say the same thing twice; leave one of them out")
    if given["pointing"] and not any(given["pointing"]):
        place.fail("pointing is zero; expected a direction, of any length")
    asked = {key: given[key] or None for key in ("tip", "pointing", "orientation")}
    return Point(given["q1"], rest=given["rest"], tip_rest=given["tip_rest"], **asked)


def _phase(place: Place, given: Mapping[str, Any], points: Mapping[str, Any]) -> PhasePlan:
    for key in ("from", "to"):
        if given[key] not in points:
            place.fail(f"{key} is the unknown point {quote(given[key])}; {did_you_mean(given[key], tuple(points))}")
    own = {key: given[key] for key in ("kind", "part", "degree", "monotone")}
    return PhasePlan(given["from"], given["to"], **own)


def _values(place: Place, value: Any) -> dict[str, float]:
    return {key: number(place, key, x, "SI units") for key, x in table_at(place, value, "of parameters").items()}


def _check_order(top: Place, scenario: Scenario) -> None:
    """Phases follow one another and fill the cycle; a joint has one spring at most."""
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


# --- with the arm ---


def fitted(scenario: Scenario, model: Model, where: str) -> Scenario:
    """The scenario for this arm, with defaults filled in; where: its file, for messages. Raises ModelError."""
    top, n = Place(printable(where)), model.n
    moving, posture = scenario.moving or tuple(range(1, n + 1)), scenario.posture or (0.0,) * n
    named = {"moving": moving, "objective: joints": scenario.objective.joints}
    named |= {f"points.{name}": tuple(point.q) for name, point in scenario.points.items()}
    named |= {"ranges": tuple(scenario.ranges), "spring": tuple(s.joint for s in scenario.springs)}
    known = [
        _declared(top.inside(f"spring {k}"), s, model) if s.joint <= n else s for k, s in enumerate(scenario.springs, 1)
    ]
    if len(posture) != n:
        top.fail(f"posture has {len(posture)} numbers; {model.name} has {n} joints")
    for name, joints in named.items():
        for joint in joints:
            if joint > n:
                top.inside(name).fail(f"there is no joint {joint}; {model.name} has {n}")
    full = replace(scenario, springs=tuple(known), moving=moving, posture=posture)
    _check_ranges(top.inside("ranges"), full, model)
    for name, point in full.points.items():
        _check_point(top.inside(f"points.{name}"), point, full, model)
    _check_electrical(top.inside("objective"), full, model)
    _check_contact(top, full, model)
    return full


def _declared(place: Place, spring: SpringPlan, model: Model) -> SpringPlan:
    """The spring with its sought parameters separated from the stated ones, by its declaration."""
    known = springs(model.library.effects)
    if spring.effect and spring.effect not in known:
        place.fail(f"effect is {quote(spring.effect)}; expected one of {', '.join(known)}")
    info = known[spring.effect or usual(known)]
    kind = model.joints[spring.joint - 1].type
    optional = tuple(p.name for p in info.linear if not p.planned)
    needed = tuple(p.name for p in info.parameters if p.name not in optional)
    written = {**{name: (x, x) for name, x in spring.stated.items()}, **spring.sought}
    for key in written:
        if key not in (*needed, *optional):
            unknown(place, "key", key, (*_OF_A_SPRING, *needed, *optional))
    for key in needed:
        if key not in written:
            place.fail(f'missing key "{key}"; needed are {", ".join(needed)}')
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


def _check_ranges(place: Place, scenario: Scenario, model: Model) -> None:
    """Each range overlaps with its joint's limits."""
    for which, (low, high) in scenario.ranges.items():
        joint = model.joints[which - 1]
        least, most = joint.position_limits or (low, high)
        if low >= most or high <= least:
            unit = joint.position_unit
            place.fail(
                f"q{which} is [{low:g}, {high:g}] {unit}; joint {which} can go from {least:g} to {most:g} {unit}"
            )


def _check_point(place: Place, point: Point, scenario: Scenario, model: Model) -> None:
    """Positions are possible; the end-effector's place has as many numbers as the arm has directions."""
    still = [j for j in point.q if j not in scenario.moving and point.q[j] != scenario.posture[j - 1]]
    if still:
        place.fail(f"joint {still[0]} does not move; add it to moving, or leave out q{still[0]}")
    for which, q in point.q.items():
        joint = model.joints[which - 1]
        low, high = joint.position_limits or (q, q)
        if not low <= q <= high:
            unit = joint.position_unit
            place.fail(f"q{which} is {q:g} {unit}; joint {which} can go from {low:g} to {high:g} {unit}")
    kind, axes = ("spatial", "x, y and z") if model.spatial else ("planar", "x and y")
    if point.tip is not None and len(point.tip) != (3 if model.spatial else 2):
        place.fail(f"tip has {len(point.tip)} numbers; {model.name} is {kind}: expected {axes}")
    for key in ("pointing", "orientation"):
        if getattr(point, key) is not None and not model.spatial:
            place.fail(f"{key} is for spatial arms; {model.name} is planar, leave it out")


def _check_electrical(place: Place, scenario: Scenario, model: Model) -> None:
    if scenario.objective.goal != "electrical_energy":
        return
    if len(scenario.objective.resistance) != model.n:
        place.fail(
            f"resistance has {len(scenario.objective.resistance)} numbers; expected {model.n}, one per joint, in Ohm"
        )
    for joint in scenario.counted:
        if model.joints[joint - 1].torque_constant is None:
            place.fail(f"electrical_energy needs the torque_constant of joint {joint} in the model file")


def _check_contact(top: Place, scenario: Scenario, model: Model) -> None:
    """Effects and phases of contact are possible with this arm."""
    for name, values in scenario.contact.items():
        place = top.inside(f"contact.{name}")
        if model.spatial:
            place.fail(f"contact is for planar arms; {model.name} is spatial, leave it out")
        info = model.library.effects.get(name)
        if model.contact is None or name not in model.contact["effects"] or info is None:
            known = tuple(model.contact["effects"]) if model.contact else ()
            place.fail(
                f"{model.name} has no such effect at its contact" + (f"; it has {', '.join(known)}" if known else "")
            )
        parameters = tuple(p.name for p in info.parameters)
        for key in values:
            if key not in parameters:
                unknown(place, "parameter", key, parameters)
    touching = [(k, p) for k, p in enumerate(scenario.phases, 1) if p.kind == "contact"]
    if not touching:
        return
    touched = model.contact and giver(model.library, map(Term, model.contact["effects"]), SURFACE)
    if "contact_inverse" not in model.functions or model.contact is None or not touched:
        top.inside(f"phase {touching[0][0]}").fail(
            "a contact phase needs a planar arm of four revolute joints with a [contact] and its plate; "
            f"{model.name} is not one"
        )
    if scenario.moving != tuple(range(1, model.n + 1)):
        top.inside("moving").fail("in a contact phase all joints move; leave moving out")
    x = float(model.contact["x"])
    for k, phase in touching:
        for name in (phase.start, phase.end):
            tip = scenario.points[name].tip
            if tip is None:
                top.inside(f"points.{name}").fail(f"contact phase {k} begins or ends here; expected a tip")
            if abs(tip[0] - x) > _CLOSE:
                top.inside(f"points.{name}").fail(f"tip has x = {tip[0]:g} m; in contact it is the plate's, {x:g} m")

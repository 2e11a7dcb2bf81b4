"""A planned motion: Bezier polynomials (9), phase by phase, in joint coordinates or in those of the contact (13)."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import BPoly

from runtime import files
from runtime.arrays import Array
from runtime.documents.plans import PolynomialEntry, TrajectoryDocument
from runtime.model.loader import Library, Model
from runtime.model.terms import Term, Values
from runtime.planning.scenario import springs, usual
from runtime.planning.settings import LONGEST_CYCLE, MOST_BYTES, MOST_PHASES, SHORTEST_PHASE
from runtime.simulation.motion_file import without_dust
from symbolic.model_file import checks
from symbolic.model_file.checks import ModelError, Place, printable, quote, real, table_at
from symbolic.model_file.fields import (
    REQUIRED,
    Choice,
    Field,
    Flag,
    JointType,
    OpenTable,
    Others,
    Real,
    Several,
    Text,
    Whole,
)
from symbolic.model_file.fields import (
    read as read_fields,
)

FORMAT = "tendon trajectory 1"
_OF_A_SPRING = ("joint", "effect")
"""Keys of a spring that are not parameters of its effect."""
MAX_POINTS = 30
"""Control points of a coordinate in a phase: polynomials of higher degree are inaccurate."""


class TrajectoryError(ValueError):
    """A trajectory file that cannot be used; the message says where, and what was expected."""


@dataclass(frozen=True)
class Phase:
    """One polynomial per coordinate.

    coordinates   "q": joint positions; "w": those of the contact, w_1 constant
    duration      s
    points        (n, M + 1) control points α_0 … α_M, rad and m
    """

    coordinates: Literal["q", "w"]
    duration: float
    points: Array

    @cached_property
    def polynomials(self) -> tuple[BPoly, BPoly, BPoly]:
        """Position, rate and acceleration over the time since the beginning of the phase."""
        position = BPoly(self.points.T[:, None, :], [0.0, self.duration])
        return position, position.derivative(1), position.derivative(2)


@dataclass(frozen=True)
class JointMotion:
    """Positions, rates and accelerations (n, N) of the joints at t (N,) s; phase (N,): its index."""

    t: Array
    q: Array
    qd: Array
    qdd: Array
    phase: NDArray[np.int64]


@dataclass(frozen=True)
class Trajectory:
    """A planned motion, which a controller follows.

    arm        name of the arm's model
    scenario   name of the scenario
    phases     one after another; from rest to rest, or periodic
    periodic   the end of the last phase is the beginning of the first
    elbow      sign of sin q_2 in contact phases
    friction   whether it was planned with friction
    springs    by joint (1-based): the parameters of its parallel spring; the arm has no others
    contact    by effect of the contact: parameters of the environment
    effects    by joint: the effect of its spring, if it is not the library's first one
    """

    arm: str
    scenario: str
    phases: tuple[Phase, ...]
    periodic: bool
    elbow: float
    friction: bool
    springs: Mapping[int, Values]
    contact: Mapping[str, Values]
    effects: Mapping[int, str] = field(default_factory=dict)

    def spring(self, library: Library, joint: int) -> Term:
        """The spring at a joint (1-based)."""
        return Term(self.effects.get(joint) or usual(library.effects), joint)

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.phases[0].points)

    @cached_property
    def starts(self) -> Array:
        """(phases + 1,) s: the beginning of each phase, and the end."""
        return np.concatenate([[0.0], np.cumsum([phase.duration for phase in self.phases])])

    @property
    def duration(self) -> float:
        """s, of all phases together."""
        return float(self.starts[-1])

    def at(self, model: Model, t: ArrayLike) -> JointMotion:
        """The motion at times (N,) s; beyond the end, a periodic one repeats and any other rests."""
        times = np.atleast_1d(np.asarray(t, dtype=np.float64))
        within = np.mod(times, self.duration) if self.periodic else np.clip(times, 0.0, self.duration)
        index = np.clip(np.searchsorted(self.starts, within, side="right") - 1, 0, len(self.phases) - 1)
        q, qd, qdd = (np.empty((self.n, len(times))) for _ in range(3))
        for k, phase in enumerate(self.phases):
            here = index == k
            if here.any():
                q[:, here], qd[:, here], qdd[:, here] = self._joints(model, phase, within[here] - self.starts[k])
        if not self.periodic:
            beyond = (times < 0.0) | (times > self.duration)
            qd[:, beyond] = qdd[:, beyond] = 0.0
        return JointMotion(times, q, qd, qdd, phase=index)

    def _joints(self, model: Model, phase: Phase, t: Array) -> tuple[Array, Array, Array]:
        c, cd, cdd = (np.ascontiguousarray(polynomial(t).T) for polynomial in phase.polynomials)
        if phase.coordinates == "q":
            return c, cd, cdd
        q = model.contact_inverse(c, self.elbow)
        # b_w is zero without rates, so that accelerations and rates have the same map.
        qd = model.contact_acceleration(q, np.zeros_like(q), cd)
        return q, qd, model.contact_acceleration(q, qd, cdd)

    def document(self) -> TrajectoryDocument:
        """In SI units; a row of control points per coordinate."""
        return TrajectoryDocument(
            format=FORMAT,
            arm=self.arm,
            scenario=self.scenario,
            periodic=self.periodic,
            elbow=self.elbow,
            friction=self.friction,
            springs=[
                {"joint": joint, **({"effect": self.effects[joint]} if joint in self.effects else {}), **values}
                for joint, values in sorted(self.springs.items())
            ],
            contact={name: dict(values) for name, values in self.contact.items()},
            phases=[
                PolynomialEntry(coordinates=p.coordinates, duration=p.duration, points=without_dust(p.points).tolist())
                for p in self.phases
            ],
        )

    def write(self, path: Path) -> None:
        """Write it as JSON. Raises OSError."""
        files.replace(path, (json.dumps(self.document().to_json(), indent=1) + "\n").encode())


def read(path: Path, model: Model) -> Trajectory:
    """The trajectory in a JSON file, for this arm. Raises TrajectoryError."""
    with _reading(path) as top:
        return _parsed(top, _document(path), model)


def arm_of(path: Path) -> str:
    """The name of the arm that the trajectory in a JSON file is for. Raises TrajectoryError."""
    with _reading(path) as top:
        data = _document(path)
        _check_format(top, data)
        arm = data.get("arm")
        if not isinstance(arm, str):
            top.fail("arm: expected the name of the arm's model")
        return arm


@contextmanager
def _reading(path: Path) -> Iterator[Place]:
    try:
        yield Place(printable(str(path)))
    except ModelError as error:
        raise TrajectoryError(str(error)) from None


def _document(path: Path) -> Any:
    """The JSON in a file. Raises TrajectoryError, ModelError."""
    if not path.exists():
        raise TrajectoryError(f"{path}: no such file; tendon optimize SCENARIO --out {path} makes one")
    text = checks.read_text(path, MOST_BYTES, "a trajectory of tendon optimize")
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:  # ValueError: not JSON, or a number of thousands of digits
        why = str(error).split(";")[0]
        raise TrajectoryError(f"{path}: not valid JSON ({why}); expected a trajectory of tendon optimize") from error


# --- the file ---


@dataclass(frozen=True)
class _ControlPoints(Field):
    """Rows of equal length with finite numbers, one per coordinate."""

    count: int

    def read(self, place: Place, value: Any, _: JointType) -> Array:
        rows = value if isinstance(value, list) else []
        if len(rows) != self.count or not all(isinstance(row, list) and len(row) == len(rows[0]) for row in rows):
            place.fail(f"points: expected {self.count} rows of equal length, one per coordinate")
        if not 2 <= len(rows[0]) <= MAX_POINTS:
            place.fail(f"points: found {len(rows[0])} in a row, expected 2 to {MAX_POINTS}")
        return np.array([[real(place, "points", x, "rad or m") for x in row] for row in rows])


def _fields(model: Model) -> tuple[Field, ...]:
    """All keys of a trajectory of this arm."""
    n = model.n
    phase = (
        Choice("coordinates", "q: joint positions; w: those of the contact", ("q", "w"), '"q" or "w"'),
        Real("duration", "of the phase", unit="s", positive=True),
        _ControlPoints("points", "of the polynomials, a row a coordinate", n, unit="rad or m"),
    )
    spring = (
        Whole("joint", "where it is mounted, counted from 1", low=1, high=n, expected=f"a joint, 1 to {n}"),
        Text("effect", "which spring, where effects of one's own add others", default=""),
        Others("PARAMETER", "of the spring, as its effect declares it", Real, _OF_A_SPRING, unit="SI", default=None),
    )
    return (
        Text("format", "of this file"),
        Text("arm", "name of the arm's model"),
        Text("scenario", "name of the scenario that it answers"),
        Flag("periodic", "whether the end is the beginning"),
        Choice("elbow", "sign of sin q_2 in contact", (1.0, -1.0), "1 or -1, the sign of sin q_2", default=1.0),
        Flag("friction", "whether it was planned with friction", default=True),
        Several("springs", "parallel springs; the arm has no others", spring, default=(), one="spring"),
        OpenTable("contact", "parameters of the contact's effects", "EFFECT.PARAMETER", "of effects", default={}),
        Several("phases", "one after another", phase, one="phase"),
    )


def _parameters(model: Model, effect: str) -> tuple[Field, ...]:
    return tuple(
        Real(
            p.name,
            p.meaning,
            *p.bounds,
            unit=p.unit.text("revolute"),
            default=REQUIRED if p.default is None else p.default,
        )
        for p in model.library[effect].parameters
    )


def _check_format(top: Place, data: Any) -> None:
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        top.fail(f'not a trajectory; expected an object with "format": "{FORMAT}" (tendon optimize --out)')


def _parsed(top: Place, data: Any, model: Model) -> Trajectory:
    _check_format(top, data)
    arm = data.get("arm", model.name)
    if arm != model.name:
        top.fail(f'is for the arm {quote(str(arm))}, but the model file describes "{model.name}"')
    given = read_fields(top, data, _fields(model))
    if not given["phases"]:
        top.fail("phases: expected at least one")
    if len(given["phases"]) > MOST_PHASES:
        top.fail(f"phases: found {len(given['phases'])}; expected at most {MOST_PHASES}")
    if (seconds := sum(phase["duration"] for phase in given["phases"])) > LONGEST_CYCLE:
        top.fail(f"phases: their durations are {seconds:.6g} s together; expected at most {LONGEST_CYCLE:g} s")
    found = Trajectory(
        arm=model.name,
        scenario=given["scenario"],
        phases=tuple(_phase(top.inside(f"phase {k}"), phase, model) for k, phase in enumerate(given["phases"], 1)),
        periodic=given["periodic"],
        elbow=given["elbow"],
        friction=given["friction"],
        springs=_springs(top, given["springs"], model),
        effects={spring["joint"]: spring["effect"] for spring in given["springs"] if spring["effect"]},
        contact=_contact(top.inside("contact"), given["contact"], model),
    )
    _check_joins(top, found, model)
    return found


def _phase(place: Place, given: Mapping[str, Any], model: Model) -> Phase:
    if given["duration"] < SHORTEST_PHASE:
        place.fail(f"duration is {given['duration']:.6g} s; expected at least {SHORTEST_PHASE:g} s")
    if given["coordinates"] == "w":
        if "contact_inverse" not in model.functions:
            place.fail(f'the arm "{model.name}" has no contact coordinates w')
        if np.ptp(given["points"][0]) > 0:
            place.fail("the first coordinate is that of the plate and must be constant")
    return Phase(**given)


def _springs(top: Place, given: Sequence[Mapping[str, Any]], model: Model) -> dict[int, Values]:
    known, found = springs(model.library.effects), {}
    for k, item in enumerate(given, 1):
        place = top.inside(f"spring {k}")
        effect = item["effect"] or usual(known)
        if effect not in known:
            place.fail(f"effect is {quote(effect)}; expected one of {', '.join(known)}")
        if item["joint"] in found:
            place.fail(f"joint {item['joint']} has a spring already; expected at most one")
        found[item["joint"]] = read_fields(place, item["PARAMETER"], _parameters(model, effect))
    return found


def _contact(place: Place, given: Mapping[str, Any], model: Model) -> dict[str, Values]:
    found = {}
    for name, values in given.items():
        here, info = place.inside(name), model.library.effects.get(name)
        if info is None or info.scope != "contact":
            place.fail(f"{quote(name)} is not an effect of the contact")
        found[name] = read_fields(here, table_at(here, values, "of parameters"), _parameters(model, name))
    return found


def _check_joins(top: Place, found: Trajectory, model: Model) -> None:
    """Positions are continuous from phase to phase: no controller may be asked to jump."""

    def end(phase: Phase, t: float) -> Array:
        return found._joints(model, phase, np.array([t]))[0][:, 0]

    ends = np.array([end(phase, phase.duration) for phase in found.phases])
    begins = np.array([end(phase, 0.0) for phase in found.phases])
    joins = list(pairwise(range(len(found.phases)))) + ([(-1, 0)] if found.periodic else [])
    for before, after in joins:
        jump = np.abs(ends[before] - begins[after])
        if not jump.max() < 1e-4:
            joint, last = int(np.argmax(jump)) + 1, before % len(found.phases) + 1
            top.fail(
                f"q{joint} jumps by {jump.max():.3g} from phase {last} to phase {after + 1}; "
                "expected continuous positions"
            )

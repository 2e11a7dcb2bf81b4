"""A planned motion: Bezier polynomials (9), phase by phase, in joint coordinates or in those of the contact (13)."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from math import isfinite
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import BPoly

from runtime import files
from runtime.model.loader import Library, Model
from runtime.model.terms import Term
from runtime.planning.springs import springs, usual

Array = NDArray[np.float64]
Values = dict[str, float]

FORMAT = "tendon trajectory 1"


class TrajectoryError(ValueError):
    """A trajectory file that cannot be used; the message says where and what was expected."""


@dataclass(frozen=True)
class Phase:
    """One polynomial a coordinate.

    coordinates   "q": joint positions; "w": those of the contact, w_1 constant
    duration      s
    points        (n, M + 1) control points α_0 … α_M, rad and m
    """

    coordinates: Literal["q", "w"]
    duration: float
    points: Array

    @cached_property
    def polynomials(self) -> tuple[BPoly, BPoly, BPoly]:
        """Position, rate and acceleration over the time since the phase began."""
        position = BPoly(self.points.T[:, None, :], [0.0, self.duration])
        return position, position.derivative(1), position.derivative(2)


@dataclass(frozen=True)
class JointMotion:
    """Positions, rates and accelerations (n, N) of the joints; phase (N,): which one, from 0."""

    t: Array
    q: Array
    qd: Array
    qdd: Array
    phase: NDArray[np.int64]


@dataclass(frozen=True)
class Trajectory:
    """What an optimization plans and a controller follows.

    arm        name of the arm's model
    scenario   name of the scenario that it answers
    phases     one after another; from rest to rest, or periodic
    periodic   the end of the last phase is the beginning of the first
    elbow      sign of sin q_2 in contact phases
    friction   whether friction was part of the model that it was planned with
    springs    by joint (1-based): the parameters of its parallel spring; the arm has no others
    contact    by effect of the contact: parameters of the environment that it was planned for
    effects    by joint: the effect that its spring is, where it is not the library's first
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
        return len(self.phases[0].points)

    @cached_property
    def starts(self) -> Array:
        """(phases + 1,) s: when each begins, and the end."""
        return np.concatenate([[0.0], np.cumsum([phase.duration for phase in self.phases])])

    @property
    def duration(self) -> float:
        return float(self.starts[-1])

    def at(self, model: Model, t: ArrayLike) -> JointMotion:
        """The motion at times (N,) s; beyond the end, a periodic one goes on and another rests."""
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
        return JointMotion(times, q, qd, qdd, index)

    def _joints(self, model: Model, phase: Phase, t: Array) -> tuple[Array, Array, Array]:
        c, cd, cdd = (np.ascontiguousarray(polynomial(t).T) for polynomial in phase.polynomials)
        if phase.coordinates == "q":
            return c, cd, cdd
        q = model.contact_inverse(c, self.elbow)
        # Without rates b_w is zero, and the map of accelerations is that of rates.
        qd = model.contact_acceleration(q, np.zeros_like(q), cd)
        return q, qd, model.contact_acceleration(q, qd, cdd)

    def to_json(self) -> dict[str, Any]:
        """SI units; control points a coordinate a row."""
        return {
            "format": FORMAT,
            "arm": self.arm,
            "scenario": self.scenario,
            "periodic": self.periodic,
            "elbow": self.elbow,
            "friction": self.friction,
            "springs": [
                {"joint": joint, **({"effect": self.effects[joint]} if joint in self.effects else {}), **values}
                for joint, values in sorted(self.springs.items())
            ],
            "contact": {name: dict(values) for name, values in self.contact.items()},
            "phases": [
                {"coordinates": p.coordinates, "duration": p.duration, "points": p.points.tolist()} for p in self.phases
            ],
        }

    def write(self, path: Path) -> None:
        files.replace(path, (json.dumps(self.to_json(), indent=1, allow_nan=False) + "\n").encode())


def read(path: Path, model: Model) -> Trajectory:
    """The trajectory in a JSON file, for this arm. Raises TrajectoryError."""
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise TrajectoryError(f"{path}: no such file; tendon optimize SCENARIO --out {path} makes one") from error
    except (OSError, UnicodeDecodeError) as error:
        raise TrajectoryError(f"{path}: cannot be read: {error}") from error
    except (json.JSONDecodeError, RecursionError) as error:
        raise TrajectoryError(f"{path}: not valid JSON ({error}); expected a trajectory of tendon optimize") from error
    return _Reader(str(path), model).trajectory(data)


@dataclass(frozen=True)
class _Reader:
    """Checks everything that a person or a program can have written."""

    where: str
    model: Model

    def fail(self, what: str) -> TrajectoryError:
        return TrajectoryError(f"{self.where}: {what}")

    def trajectory(self, data: Any) -> Trajectory:
        if not isinstance(data, dict) or data.get("format") != FORMAT:
            raise self.fail(f'not a trajectory; expected an object with "format": "{FORMAT}" (tendon optimize --out)')
        missing = [key for key in ("arm", "scenario", "periodic", "phases") if key not in data]
        if missing:
            raise self.fail(f"has no {missing[0]}")
        if data["arm"] != self.model.name:
            raise self.fail(f'is for the arm "{data["arm"]}", and the model file is of "{self.model.name}"')
        phases = self._list(data["phases"], "phases")
        if not phases:
            raise self.fail("phases: expected at least one")
        found = Trajectory(
            arm=self.model.name,
            scenario=str(data["scenario"]),
            phases=tuple(self._phase(item, f"phase {k}") for k, item in enumerate(phases, 1)),
            periodic=self._flag(data["periodic"], "periodic"),
            elbow=self._number(data.get("elbow", 1.0), "elbow"),
            friction=self._flag(data.get("friction", True), "friction"),
            springs=self._springs(self._list(data.get("springs", []), "springs")),
            contact=self._contact(data.get("contact", {})),
            effects={item["joint"]: item["effect"] for item in data.get("springs", []) if "effect" in item},
        )
        if found.elbow not in (-1.0, 1.0):
            raise self.fail(f"elbow is {found.elbow:g}; expected 1 or -1, the sign of sin q_2")
        self._check_joins(found)
        return found

    def _phase(self, item: Any, name: str) -> Phase:
        if not isinstance(item, dict) or item.get("coordinates") not in ("q", "w"):
            raise self.fail(f'{name}: expected an object with "coordinates": "q" or "w"')
        if item["coordinates"] == "w" and "contact_inverse" not in self.model.functions:
            raise self.fail(f'{name}: the arm "{self.model.name}" has no contact coordinates w')
        duration = self._number(item.get("duration"), f"{name}: duration")
        if duration <= 0:
            raise self.fail(f"{name}: duration is {duration:g}; expected more than 0 s")
        rows = self._list(item.get("points"), f"{name}: points")
        if len(rows) != self.model.n or len({len(self._list(row, f"{name}: points")) for row in rows}) != 1:
            raise self.fail(f"{name}: points: expected {self.model.n} rows of equal length, one a coordinate")
        if not 2 <= len(rows[0]) <= 30:
            raise self.fail(f"{name}: points: found {len(rows[0])} a row, expected 2 to 30")
        points = np.array([[self._number(x, f"{name}: points") for x in row] for row in rows])
        if item["coordinates"] == "w" and np.ptp(points[0]) > 0:
            raise self.fail(f"{name}: the first coordinate is that of the plate and must be constant")
        return Phase(item["coordinates"], duration, points)

    def _springs(self, items: list[Any]) -> dict[int, Values]:
        found: dict[int, Values] = {}
        for item in items:
            joint = item.get("joint") if isinstance(item, dict) else None
            if not isinstance(joint, int) or not 1 <= joint <= self.model.n or joint in found:
                raise self.fail(f'springs: expected objects with "joint": 1 to {self.model.n}, each once')
            name = f"spring at joint {joint}"
            known = springs(self.model.library.effects)
            effect = item.get("effect", next(iter(known)))
            if not isinstance(effect, str) or effect not in known:
                raise self.fail(f"{name}: effect is {json.dumps(effect)}; expected one of {', '.join(known)}")
            values = {k: v for k, v in item.items() if k not in ("joint", "effect")}
            found[joint] = self._values(effect, values, name)
        return found

    def _contact(self, data: Any) -> dict[str, Values]:
        if not isinstance(data, dict):
            raise self.fail("contact: expected an object of effects")
        for name in data:
            info = self.model.library.effects.get(name)
            if info is None or info.scope != "contact":
                raise self.fail(f'contact: "{name}" is no effect of the contact')
        return {name: self._values(name, values, f"contact: {name}") for name, values in data.items()}

    def _values(self, effect: str, values: Any, name: str) -> Values:
        known = {p.name: p for p in self.model.library[effect].parameters}
        if not isinstance(values, dict) or not values.keys() <= known.keys():
            raise self.fail(f"{name}: expected some of {', '.join(known)}")
        found = {key: self._number(value, f"{name}: {key}") for key, value in values.items()}
        for key, parameter in known.items():
            if key not in found:
                if parameter.default is None:
                    raise self.fail(f"{name}: has no {key}")
                found[key] = parameter.default
            low, high = parameter.bounds
            if not low <= found[key] <= high:
                raise self.fail(f"{name}: {key} is {found[key]:g}; expected {low:g} to {high:g}")
        return found

    def _check_joins(self, found: Trajectory) -> None:
        """A jump of the position is a broken file; no controller should see it."""
        ends = np.array([self._end(found, phase, phase.duration) for phase in found.phases])
        begins = np.array([self._end(found, phase, 0.0) for phase in found.phases])
        joins = list(pairwise(range(len(found.phases)))) + ([(-1, 0)] if found.periodic else [])
        for before, after in joins:
            jump = np.abs(ends[before] - begins[after])
            if not jump.max() < 1e-4:
                joint, last = int(np.argmax(jump)) + 1, before % len(found.phases) + 1
                raise self.fail(
                    f"q{joint} jumps by {jump.max():.3g} from phase {last} to phase {after + 1}; "
                    "expected continuous positions"
                )

    def _end(self, found: Trajectory, phase: Phase, t: float) -> Array:
        return found._joints(self.model, phase, np.array([t]))[0][:, 0]

    def _list(self, value: Any, name: str) -> list[Any]:
        if not isinstance(value, list):
            raise self.fail(f"{name}: expected a list")
        return value

    def _flag(self, value: Any, name: str) -> bool:
        if not isinstance(value, bool):
            raise self.fail(f"{name}: expected true or false")
        return value

    def _number(self, value: Any, name: str) -> float:
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not isfinite(value):
            raise self.fail(f"{name}: expected a finite number")
        return float(value)

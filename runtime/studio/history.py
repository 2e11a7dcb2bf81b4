"""The steps of a session: a model text each, what was changed in it, and what the error of every joint is with it.

Nothing that was computed is thrown away: a step that was undone stays, and what is done instead of it stands beside it.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from math import isfinite
from typing import Any, Literal, cast, get_args

Kind = Literal["given", "added", "without"]
"""What made a step: the model as given; an effect, or several, that were added; one that was left out."""


VERDICTS = (None, "effect", "clean", "unexplained", "refused")
"""Of a step's diagnosis; None: not asked for."""

_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*", re.ASCII)
"""Of an effect: it stands in commands."""


class HistoryError(ValueError):
    """A history that is none, or a step that is not in it; the message says which."""


@dataclass(frozen=True)
class PlacedEffect:
    """An effect of a model file: its name there, and its joint (1-based), None: the whole arm's."""

    effect: str
    joint: int | None

    def __str__(self) -> str:
        return self.effect if self.joint is None else f"{self.effect}@{self.joint}"


@dataclass(frozen=True)
class JointError:
    """What a fitted model leaves of a joint's torque, and the noise floor of it.

    unit                   of the joint's torque
    rms, floor             in that unit; relative, relative_floor: parts of the torque
    held, held_floor       the same two parts on the recordings that were held out; None where there are none
    """

    joint: int
    called: str
    unit: str
    rms: float
    relative: float
    floor: float
    relative_floor: float
    held: float | None = None
    held_floor: float | None = None

    @property
    def floors(self) -> float | None:
        """The error in noise floors; None where there is no floor."""
        return self.rms / self.floor if self.floor else None


@dataclass(frozen=True)
class SessionStep:
    """A model that was fitted.

    number    of the step, from 0
    parent    the step that it changes; None for the model as given
    changed   what was added or left out
    verdict   of the diagnosis of this step: "effect", "clean", "unexplained" or "refused"; None: not asked for
    """

    number: int
    parent: int | None
    kind: Kind
    changed: tuple[PlacedEffect, ...]
    joints: tuple[JointError, ...]
    verdict: str | None = None

    @property
    def title(self) -> str:
        """What the step did, in a few words."""
        names = ", ".join(map(str, self.changed))
        return {"given": "as given, fitted", "added": f"+ {names}", "without": f"without {names}"}[self.kind]


@dataclass(frozen=True)
class History:
    """Steps in the order in which they were made; `current` is where the user stands, None before the first.

    undone   the steps that redo goes to, the nearest last
    """

    steps: tuple[SessionStep, ...] = ()
    current: int | None = None
    undone: tuple[int, ...] = ()

    def step(self, number: int) -> SessionStep:
        """Raises HistoryError."""
        if not 0 <= number < len(self.steps):
            raise HistoryError(f"there is no step {number}; expected 0 to {len(self.steps) - 1}")
        return self.steps[number]

    @property
    def here(self) -> SessionStep | None:
        """The current step."""
        return None if self.current is None else self.steps[self.current]

    def path(self, number: int) -> tuple[SessionStep, ...]:
        """From the model as given to a step."""
        found: list[SessionStep] = [self.step(number)]
        while (parent := found[0].parent) is not None:
            found.insert(0, self.steps[parent])
        return tuple(found)

    def with_step(self, step: SessionStep) -> History:
        """One step more, at which the user then stands."""
        if step.number != len(self.steps):
            raise HistoryError(f"step {step.number} cannot follow {len(self.steps)} steps")
        return History((*self.steps, step), step.number)

    def judged(self, number: int, verdict: str) -> History:
        """With the verdict of a step's diagnosis."""
        step = replace(self.step(number), verdict=verdict)
        return replace(self, steps=(*self.steps[:number], step, *self.steps[number + 1 :]))

    @property
    def can_undo(self) -> bool:
        return self.here is not None and self.here.parent is not None

    @property
    def can_redo(self) -> bool:
        return bool(self.undone)

    def undo(self) -> History:
        """Back to the step that the current one changes."""
        here = self.here
        if here is None or here.parent is None:
            raise HistoryError("there is nothing to undo")
        return replace(self, current=here.parent, undone=(*self.undone, here.number))

    def redo(self) -> History:
        """Forward to the step that was undone last."""
        if not self.undone:
            raise HistoryError("there is nothing to redo")
        return replace(self, current=self.undone[-1], undone=self.undone[:-1])

    def at(self, number: int) -> History:
        """At any step."""
        return replace(self, current=self.step(number).number, undone=())

    def to_json(self) -> dict[str, Any]:
        return asdict(self)

    @classmethod
    def of_json(cls, document: object) -> History:
        """The history that a session file holds. Raises HistoryError: the file may be anyone's."""
        try:
            return _history(cast(Mapping[str, Any], document))
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise HistoryError(f"holds no history of steps: {error}") from error


def _history(document: Mapping[str, Any]) -> History:
    steps = tuple(_step(k, entry) for k, entry in enumerate(document["steps"]))
    current = document["current"]
    undone = tuple(_number(k, steps) for k in document["undone"])
    return History(steps, None if current is None and not steps else _number(current, steps), undone)


def _step(number: int, entry: Mapping[str, Any]) -> SessionStep:
    kind, parent, verdict = entry["kind"], entry["parent"], entry["verdict"]
    if kind not in get_args(Kind) or entry["number"] != number or verdict not in VERDICTS:
        raise ValueError(f"step {number} is none")
    if (parent is None) != (number == 0) or (parent is not None and not 0 <= int(parent) < number):
        raise ValueError(f"step {number} follows no step before it")
    changed = tuple(map(_effect, entry["changed"]))
    return SessionStep(number, parent, kind, changed, joint_errors(entry["joints"]), verdict)


def _effect(entry: Mapping[str, Any]) -> PlacedEffect:
    effect, joint = entry["effect"], entry["joint"]
    if not _NAME.fullmatch(effect) or not (joint is None or (isinstance(joint, int) and joint > 0)):
        raise ValueError(f"{effect!r} at {joint!r} is no effect")
    return PlacedEffect(effect, joint)


def joint_errors(entries: Sequence[Mapping[str, Any]]) -> tuple[JointError, ...]:
    """Of a step, from JSON. Raises TypeError where they are none."""
    return tuple(_joint_error(entry) for entry in entries)


def _joint_error(entry: Mapping[str, Any]) -> JointError:
    """Raises TypeError, ValueError."""
    found = JointError(**entry)
    numbers = (found.rms, found.relative, found.floor, found.relative_floor, found.held, found.held_floor)
    for value in numbers:
        if not (value is None or (isinstance(value, int | float) and isfinite(value) and value >= 0)):
            raise ValueError(f"{value!r} is no error of a joint")
    if None in numbers[:4] or type(found.joint) is not int or found.joint < 1:
        raise ValueError("a joint lacks its number or its errors")
    if not isinstance(found.called, str) or not isinstance(found.unit, str):
        raise ValueError("a joint lacks its name or its unit")
    return found


def _number(value: object, steps: Sequence[SessionStep]) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value < len(steps):
        raise ValueError(f"there is no step {value}")
    return value

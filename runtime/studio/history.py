"""The steps of a session: fitted models, each with what it was fitted to, and the way back and forth between them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal

from msgspec import Meta
from msgspec.structs import replace

from runtime.documents.parts import Document
from runtime.studio.inputs import Inputs

Kind = Literal["given", "added", "without"]
"""How a step was made: the model as given, effects added, or an effect left out."""
Verdict = Literal["effect", "clean", "unexplained", "refused"]
JointNumber = Annotated[int, Meta(ge=1)]
Magnitude = Annotated[float, Meta(ge=0)]


class HistoryError(ValueError):
    """A move in the history that is not possible, or a step that does not exist; the message says which."""


class PlacedEffect(Document, frozen=True):
    """An effect of a model file: its name there, and its joint (1-based), None: of the whole arm."""

    effect: Annotated[str, Meta(pattern=r"^[A-Za-z_][A-Za-z0-9_]*\Z")]  # it stands in commands
    joint: JointNumber | None

    def __str__(self) -> str:
        return self.effect if self.joint is None else f"{self.effect}@{self.joint}"


class JointError(Document, frozen=True, kw_only=True):
    """The residual of a joint's torque with a fitted model, and its noise floor.

    called                 number and name, as headings have it
    rms, floor             in `unit`; relative, relative_floor: parts of the torque's rms
    held, held_floor       relative error and noise floor of the held-out recordings; None without any
    """

    joint: JointNumber
    called: str
    unit: str
    rms: Magnitude
    relative: Magnitude
    floor: Magnitude
    relative_floor: Magnitude
    held: Magnitude | None = None
    held_floor: Magnitude | None = None

    @property
    def floors(self) -> float | None:
        """The error in noise floors; None where there is no floor."""
        return self.rms / self.floor if self.floor else None


class SessionStep(Document, frozen=True, kw_only=True):
    """A fitted model.

    number    of the step, from 0; parent: the step that it changes, None for the first; of a later model as given it is
              the step that was shown before
    inputs    to which it was fitted
    changed   the effects that were added or left out
    verdict   of its diagnosis; None before that
    """

    number: int
    parent: int | None
    kind: Kind
    inputs: Inputs
    changed: tuple[PlacedEffect, ...]
    joints: tuple[JointError, ...]
    verdict: Verdict | None = None

    @property
    def title(self) -> str:
        """The change in a few words."""
        names, again = ", ".join(map(str, self.changed)), " again" if self.parent is not None else ""
        return {"given": f"as given, fitted{again}", "added": f"+ {names}", "without": f"without {names}"}[self.kind]


class History(Document, frozen=True):
    """Steps in the order in which they were made. Steps that were undone stay.

    current   number of the step that is shown; None before the first
    undone    numbers of the steps that redo returns to, the next one last
    """

    steps: tuple[SessionStep, ...] = ()
    current: int | None = None
    undone: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        for number, step in enumerate(self.steps):
            if step.number != number or (step.parent is None) != (number == 0) or not -1 < (step.parent or 0) <= number:
                raise HistoryError(f"step {number} has a wrong number or follows no earlier step")
        if (self.current is None) != (not self.steps):
            raise HistoryError("the number of the current step is missing")
        for number in (*self.undone, *(() if self.current is None else (self.current,))):
            self.step(number)

    def step(self, number: int) -> SessionStep:
        """Raises HistoryError where there is no such step."""
        if not 0 <= number < len(self.steps):
            raise HistoryError(f"there is no step {number}; expected 0 to {len(self.steps) - 1}")
        return self.steps[number]

    @property
    def here(self) -> SessionStep | None:
        """The current step."""
        return None if self.current is None else self.steps[self.current]

    def path(self, number: int) -> tuple[SessionStep, ...]:
        """From the model as given, fitted to the same inputs, to a step."""
        found = [self.step(number)]
        while found[0].kind != "given" and (parent := found[0].parent) is not None:
            found.insert(0, self.steps[parent])
        return tuple(found)

    def with_steps(self, *steps: SessionStep) -> History:
        """With further steps, the last of which becomes the current one."""
        return History((*self.steps, *steps), steps[-1].number)

    def judged(self, number: int, verdict: Verdict) -> History:
        """With the verdict of a step's diagnosis."""
        step = replace(self.step(number), verdict=verdict)
        return replace(self, steps=(*self.steps[:number], step, *self.steps[number + 1 :]))

    def undo(self) -> History:
        """Back to the step that the current one changes."""
        here = self.here
        if here is None or here.parent is None:
            raise HistoryError("there is nothing to undo")
        return replace(self, current=here.parent, undone=(*self.undone, here.number))

    def redo(self) -> History:
        """To the step that was undone last."""
        if not self.undone:
            raise HistoryError("there is nothing to redo")
        return replace(self, current=self.undone[-1], undone=self.undone[:-1])

    def at(self, number: int) -> History:
        """At any step."""
        return replace(self, current=self.step(number).number, undone=())


def changes(path: Sequence[SessionStep]) -> tuple[list[PlacedEffect], list[PlacedEffect]]:
    """The effects that the last step of a path has and the first has not, and the reverse."""
    added: list[PlacedEffect] = []
    removed: list[PlacedEffect] = []
    for step in path:
        own, opposite = (removed, added) if step.kind == "without" else (added, removed)
        for effect in step.changed:
            if effect in opposite:
                opposite.remove(effect)
            else:
                own.append(effect)
    return added, removed

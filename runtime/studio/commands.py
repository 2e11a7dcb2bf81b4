"""The commands that do in a terminal what was done in a session."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path

from runtime.report.follow_up import Invocation, reading
from runtime.studio.history import PlacedEffect, SessionStep
from runtime.studio.session import Inputs
from symbolic.model_file.checks import quote


def invocation(inputs: Inputs, about: str = "") -> Invocation:
    """The command line that has the inputs of a session."""
    assert inputs.model is not None
    return Invocation(
        Path(f"{inputs.like}.toml" if inputs.like else inputs.model.typed),
        tuple(Path(r.given.typed) for r in inputs.fitted),
        tuple(Path(r.given.typed) for r in inputs.held_out),
        None if inputs.effects is None else Path(inputs.effects),
        inputs.maps,
        inputs.allow_gaps,
        about=about,
        like=inputs.like,
    )


def commands(inputs: Inputs, path: Sequence[SessionStep]) -> list[str]:
    """Line by line, from the model as given to the last step of a path."""
    given = invocation(inputs)
    added, removed = changes(path)
    data = [*map(str, given.recordings), *reading(inputs.maps, inputs.allow_gaps)]
    held = [part for r in given.held_out for part in ("--held-out", str(r))]
    own = [] if given.effects is None else ["--effects", str(given.effects)]
    lines = [given.copy()] if given.like else []
    lines.append(shlex.join(["tendon", "improve", str(given.model), *data, *held, "--report", "report", *own]))
    lines += [f"# take {effect} out of {quote(str(given.model))}" for effect in removed]
    for effect in added:
        at = [] if effect.joint is None else ["--joint", str(effect.joint)]
        lines.append(shlex.join(["tendon", "add", str(given.model), effect.effect, *at, *own]))
    return [*lines, shlex.join(["tendon", "identify", str(given.model), *data, "--write", *own])]


def changes(path: Sequence[SessionStep]) -> tuple[list[PlacedEffect], list[PlacedEffect]]:
    """What the last step of a path has more than the first, and what it lacks of it."""
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

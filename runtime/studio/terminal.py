"""The same in a terminal: the command lines that lead to a step of a session."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path

from runtime.model.terms import Term
from runtime.report.summary import Invocation, reading
from runtime.studio.history import SessionStep, changes
from runtime.studio.inputs import GivenReading, Inputs
from symbolic.model_file.checks import quote


def invocation(inputs: Inputs, about: str = "") -> Invocation:
    """The command line with the inputs of a session. A command reads all its recordings in one way: where they are read
    in different ways it has none of them, and `commands` says so."""
    assert inputs.model is not None
    ways = {r.reading for r in inputs.recordings}
    how = ways.pop() if len(ways) == 1 else GivenReading()
    return Invocation(
        model=Path(f"{inputs.like}.toml" if inputs.like else inputs.model.typed),
        recordings=tuple(Path(r.given.typed) for r in inputs.fitted),
        held_out=tuple(Path(r.given.typed) for r in inputs.held_out),
        effects=None if inputs.effects is None else Path(inputs.effects),
        maps=how.maps,
        allow_gaps=how.allow_gaps,
        about=about,
        like=inputs.like,
    )


def commands(path: Sequence[SessionStep]) -> list[str]:
    """Command lines that lead from the model as given to the last step of a path."""
    inputs = path[-1].inputs
    given = invocation(inputs)
    added, removed = changes(path)
    held = [part for r in given.held_out for part in ("--held-out", str(r))]
    own = [] if given.effects is None else ["--effects", str(given.effects)]
    data = [*map(str, given.recordings), *reading(given.maps, given.allow_gaps), *held]
    return [
        *_apart(inputs),
        *([given.copy()] if given.like else []),
        *_importing(inputs),
        *(
            f"# set torque_constant = {value:g} in joint {joint} of {quote(str(given.model))}"
            for joint, value in inputs.constants.items()
        ),
        shlex.join(["tendon", "improve", str(given.model), *data, "--report", "report", *own]),
        *(f"# remove {effect} from {quote(str(given.model))}" for effect in removed),
        *(given.add(Term(effect.effect, effect.joint)) for effect in added),
        given.identify(),
    ]


def _importing(inputs: Inputs) -> list[str]:
    """Makes the model file from a robot description."""
    arm = inputs.described
    if arm is None or inputs.model is None:
        return []
    ends = [part for name, link in (("--base", arm.base), ("--tip", arm.tip)) if link for part in (name, link)]
    return [shlex.join(["tendon", "import", arm.file.typed, *ends, "--out", inputs.model.typed])]


def _apart(inputs: Inputs) -> list[str]:
    """Comments on recordings that are read in different ways."""
    if len({r.reading for r in inputs.recordings}) < 2:
        return []
    lines = ["# These recordings are read in different ways, and a command reads all in one; name their columns alike:"]
    for r in inputs.recordings:
        how = shlex.join(reading(r.reading.maps, r.reading.allow_gaps)) or "as it is"
        lines.append(f"#   {quote(r.given.typed)}: {quote(how)}")
    return lines

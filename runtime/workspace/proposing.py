"""The user's model file with what its controller lacks, proposed; nothing is written."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import TYPE_CHECKING

from runtime.workspace.source import Source
from symbolic.model_file.arm import ROTOR, ProposedValue

if TYPE_CHECKING:
    from runtime.hardware.tuning import Loop
    from runtime.model.loader import Model
    from runtime.workspace.edits import ModelEdits


@dataclass(frozen=True)
class ProposedController:
    """The edits of the file, the values that they set, and the position loop of the gains."""

    edits: ModelEdits
    values: tuple[ProposedValue, ...]
    loop: Loop


def propose_controller(source: Source, new_gains: bool = False) -> ProposedController:
    """Everything that the controller of an arm needs and its file leaves out; values that stand there stay.

    new_gains   gains that stand in the file are proposed anew
    Raises ModelError: masses of links are unknown, or no gains are stable.
    """
    from runtime.hardware import tuning

    rotors = tuple(_rotors(source))
    model = _compiled(source, rotors)
    control, unknown = model.controller, tuple(tuning.effect_values(model))
    known = (*rotors, *unknown)
    shared = () if control is not None else tuple(tuning.shared(identified=not unknown))
    stated = control or {one.key: one.value for one in shared}
    found = tuning.loop(model, stated["rate"], stated["velocity_cutoff"])
    lacking = chain(tuning.encoders(model), tuning.gains(model, found, new_gains))
    limits = tuning.torque_limits(_compiled(source, known))
    values = (*known, *limits, *shared, *lacking)
    return ProposedController(source.edits.propose(values), values, found)


def _rotors(source: Source) -> Iterator[ProposedValue]:
    for number in source.compiled.with_likely_numbers()[1]:
        if number.parameter == ROTOR and number.value is not None:
            yield ProposedValue(number.joint, (), ROTOR, number.value, f"assumed: {number.reason}")


def _compiled(source: Source, values: Sequence[ProposedValue]) -> Model:
    """The arm with these values. Raises ModelError."""
    return source.with_text(source.edits.propose(values).text).compiled.model()

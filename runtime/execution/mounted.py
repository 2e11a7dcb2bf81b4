"""The effects of an arm as a trajectory finds it: with its springs and contact, and what a user hides or changes."""

from __future__ import annotations

from collections.abc import Sequence

from runtime.execution.equations import PlantError, check_complete
from runtime.loader import Model
from runtime.planning.trajectory import SPRING, Trajectory
from runtime.simulate import Hidden
from runtime.terms import Structure, Term, structure


def mounted(model: Model, trajectory: Trajectory) -> Structure:
    """What the model file activates, the trajectory's springs and contact in place of the file's."""
    found = {t: v for t, v in structure(model).items() if t.effect != SPRING and not _is_contact(model, t)}
    springs = {Term(SPRING, joint): dict(values) for joint, values in trajectory.springs.items()}
    contact = {Term(name): dict(values) for name, values in trajectory.contact.items()}
    return {**found, **springs, **contact}


def actual(model: Model, terms: Structure, changed: Sequence[Hidden], hidden: Sequence[Hidden]) -> Structure:
    """The arm's own: `terms` with other values, and with effects that the model has not. Raises PlantError."""
    found = {term: dict(values) for term, values in terms.items()}
    for item in changed:
        if item.term not in found:
            raise PlantError(f"--set {item.term}: {model.name} does not have this effect here; --hide puts it in")
        if not item.values:
            raise PlantError(f"--set {item.term}: sets nothing; write --set {item.term}:KEY=VALUE,...")
        found[item.term] |= item.values
    check_complete(model, found)
    for item in hidden:
        if item.term in found:
            raise PlantError(f"--hide {item.term}: {model.name} has this effect already; --set changes its values")
        found[item.term] = dict(item.values)
    return found


def _is_contact(model: Model, term: Term) -> bool:
    return model.library[term.effect].scope == "contact"

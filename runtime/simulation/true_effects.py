"""The effects that a simulated arm has: those of its model, with other values and hidden ones as a user wants them."""

from __future__ import annotations

from collections.abc import Sequence

from runtime.model.loader import Model
from runtime.model.terms import Structure, check_complete
from runtime.simulation.plant_equations import PlantError
from runtime.simulation.simulate import Hidden


def actual(model: Model, terms: Structure, changed: Sequence[Hidden], hidden: Sequence[Hidden]) -> Structure:
    """`terms` with other values, and with effects that the model has not; these may lack values yet.

    Raises PlantError: nothing to change, something there already; ModelError: a value of the model's own that nobody
    knows.
    """
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

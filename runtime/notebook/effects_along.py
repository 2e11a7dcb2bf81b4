"""Torques of a model with all its effects along given motion, from the generated C."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from runtime.arrays import Array
from runtime.model.catalogue import LoaderError
from runtime.model.loader import Model
from runtime.model.terms import (
    OF_DRIVE,
    SignalContext,
    Structure,
    Term,
    UnknownHere,
    check_complete,
    given,
    joints_of,
    structure,
)


@dataclass
class GivenMotion(SignalContext):
    """The signals that effects read along motion (n, N) as it is given, without filters.

    dt   s from sample to sample; None: the samples have nothing to do with one another
    """

    model: Model
    values: Structure
    q: Array
    qd: Array
    qdd: Array
    dt: float | None

    def coordinate(self, name: str) -> Array:
        return {"q": self.q, "qd": self.qd, "qdd": self.qdd}[name]

    def evaluate(self, function: str) -> Array:
        inputs = self.model.metadata["functions"][function]["inputs"]
        return self.model.call(function, {name: self.coordinate(name) for name, _ in inputs}, self.model.lump_values)

    def given(self, name: str) -> float | None:
        return given(self.model.library, self.values, name)

    def time(self) -> Array:
        times: Array = np.arange(self.q.shape[1], dtype=np.float64) * self._step("the time")
        return times

    def terms(self) -> Collection[Term]:
        return self.values.keys()

    def torque(self, term: Term, joint: int) -> Array:
        """(N,) at a joint (0-based)."""
        library = self.model.library
        info, read = library[term.effect], self.reader(term, joint)
        dt = self._step("what was before") if info.states else 0.0
        # The time tells how many samples there are.
        signals = {"t": np.zeros(self.q.shape[1]), **{name: read(name) for name in info.signals}}
        return library.torque(term.effect, signals, self.values[term], dt)

    def predicted(self, joint: int) -> Array:
        return self.total(joint, of_drive=False)

    def predicted_rate(self, joint: int) -> Array:
        step = self._step("the rate of the torque")
        return np.asarray(np.gradient(self.predicted(joint), step), dtype=np.float64)

    def total(self, joint: int, of_drive: bool = True) -> Array:
        """(N,) of the arm and its effects at a joint (0-based); of_drive: with those of its drive, too."""
        found: Array = self.arm("inverse_dynamics")[joint].copy()
        for term in self.values:
            drive = bool(self.model.library.needs[term.effect] & OF_DRIVE)
            if joint in joints_of(self.model, term) and (of_drive or not drive):
                found += self.torque(term, joint)
        return found

    def _step(self, what: str) -> float:
        if self.dt is None:
            raise UnknownHere(what)
        return self.dt


def whole_torque(model: Model, q: Array, qd: Array, qdd: Array, dt: float | None) -> Array:
    """(n, N) torques of the motors with all effects of the model file, for motion (n, N).

    dt   as for GivenMotion
    Raises ModelError if a value is unknown, LoaderError for a wrong dt or an effect that depends on what is not given.
    """
    if dt is not None and not 0.0 < dt < np.inf:
        raise LoaderError(f"{model.name}: dt is {dt}; expected seconds from sample to sample, more than 0")
    values = structure(model)
    check_complete(model, values)
    motion = GivenMotion(model, values, q, qd, qdd, dt)
    try:
        return np.array([motion.total(joint) for joint in range(model.n)])
    except UnknownHere as unknown:
        cure = "pass dt, the time from sample to sample" if dt is None else "compare knows it of a recording"
        raise LoaderError(f"{model.name}: an effect depends on {unknown}; {cure}") from unknown

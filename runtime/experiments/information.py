"""How much a motion tells of all unknown parameters of an arm at once, and the gradient of that by the motion.

The measure is the information in nats that a recording adds to what is known before: half of log det(1 + S F S), F the
information of the torques about the parameters and S the spread of possible arms. Its columns are the generated
regressor and the derivatives of the effects' torques, evaluated with their gradients by the generated CasADi functions.
Source: Sun & Ruiz 2016 and Swevers et al. 1997 (log det); Chaloner & Verdinelli 1995 (with what is known before).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np

from runtime.arrays import Array
from runtime.experiments.possible_arms import PossibleArms, upper
from runtime.experiments.settings import CORNER_RATE, FRICTION_SPREAD, ROWS_A_SECOND, SURE_SPREADS
from runtime.model import casadi_functions
from runtime.model.batch import Batch
from runtime.model.terms import Term, unknown_to_plan
from runtime.planning.physics import Physics, PlanInstant


@dataclass(frozen=True)
class InstantOutputs:
    """By sample: regressor Y (N, n, p), derivatives E (N, n, m) of the torques by the effects' parameters, torques tau
    (N, n), and the squared speed of the tip (N,)."""

    Y: Array
    E: Array
    tau: Array
    tip_speed2: Array


@dataclass(frozen=True)
class ArmInformation:
    """The likeliest arm's columns along motions of `count` samples.

    noise   (n,) standard deviation of a torque's row in the band, N m (N)
    known   (P, P) what recordings at hand tell, as `told`; None: there are none
    """

    arms: PossibleArms
    count: int
    noise: Array
    known: Array | None = None

    @cached_property
    def terms(self) -> list[Term]:
        """The effects whose torque follows from the motion at one instant; others are left out of the search. Those
        that the arm may have besides come last."""
        library = self.arms.model.library
        return [
            term
            for term in (*self.arms.values, *self.arms.wondered)
            if not library[term.effect].states and not unknown_to_plan(library, term.effect)
        ]

    @cached_property
    def _values(self) -> dict[Term, tuple[list[float], Array]]:
        """Of each term its parameters in declared order, and their standard deviations; an effect that the arm may have
        besides is of size zero, and may be moderate."""
        found = {}
        for term in self.terms:
            info, own = self.arms.model.library[term.effect], term in self.arms.values
            known = self.arms.values[term] if own else self.arms.wondered[term]
            values = casadi_functions.ordered(self.arms.model, term.effect, known)
            spreads = (upper(FRICTION_SPREAD) if own else 1.0) * np.abs(values)
            sizes = [0.0 if p.role == "linear" else v for p, v in zip(info.parameters, values, strict=True)]
            found[term] = (values if own else sizes, spreads)
        return found

    @cached_property
    def spreads(self) -> Array:
        """(m,) standard deviations of the effects' parameters, in the order of `terms`."""
        return np.concatenate([np.zeros(0), *(spreads for _, spreads in self._values.values())])

    @cached_property
    def _batches(self) -> tuple[Batch, Batch]:
        """Outputs by q, qd, qdd; and the gradient of their weighted sum by the same."""
        model = self.arms.model
        physics = Physics(model, {**self.arms.values, **self.arms.wondered}, {})
        physics = replace(physics, terms={term: physics.terms[term] for term in self.terms})
        values = physics.values(CORNER_RATE)
        q, qd, qdd = (ca.SX.sym(name, model.n) for name in ("q", "qd", "qdd"))
        free = {str(term): ca.SX.sym(f"p{k}", len(values[str(term)])) for k, term in enumerate(self.terms)}
        given = {name: ca.SX(ca.DM(values[name])) for name in ("struct", "width")}
        instant = PlanInstant(physics, q, qd, qdd, springs={}, p=(given | free).__getitem__, apart=False)
        parameters = ca.vertcat(*free.values())
        at = ca.DM([v for own, _ in self._values.values() for v in own])
        tau, E = ca.Function("at", [q, qd, qdd, parameters], [instant.torque, ca.jacobian(instant.torque, parameters)])(
            q, qd, qdd, at
        )
        own = {"q": q, "qd": qd, "qdd": qdd}
        Y = casadi_functions.evaluate(model, "regressor", given["struct"], own.__getitem__)
        outputs = [ca.densify(Y), ca.densify(E), tau, ca.sumsqr(instant.tip_rate)]
        weights = [ca.SX.sym(f"w{k}", *output.shape) for k, output in enumerate(outputs)]
        total = sum(ca.dot(w, output) for w, output in zip(weights, outputs, strict=True))
        slopes = [ca.gradient(total, variable) for variable in (q, qd, qdd)]
        forward = ca.Function("outputs", [q, qd, qdd], outputs)
        backward = ca.Function("slopes", [q, qd, qdd, *weights], ca.cse(slopes))
        return Batch(forward, self.count), Batch(backward, self.count)

    def outputs(self, q: Array, qd: Array, qdd: Array) -> InstantOutputs:
        """Along a motion (n, N)."""
        Y, E, tau, speed2 = self._batches[0](q.T, qd.T, qdd.T)
        return InstantOutputs(Y.transpose(0, 2, 1), E.transpose(0, 2, 1), tau[:, 0], speed2[:, 0, 0])

    def slopes(self, q: Array, qd: Array, qdd: Array, by: InstantOutputs) -> tuple[Array, Array, Array]:
        """Gradients (n, N) by q, qd, qdd of the outputs' sum with the weights `by`, of their shapes."""
        flat = (by.Y.transpose(0, 2, 1), by.E.transpose(0, 2, 1), by.tau, by.tip_speed2[:, None])
        made = self._batches[1](q.T, qd.T, qdd.T, *(w.reshape(self.count, -1) for w in flat))
        found = [part[:, 0].T.copy() for part in made]
        return found[0], found[1], found[2]

    def told(self, q: Array, qd: Array, qdd: Array, rate: float) -> Array:
        """(P, P) information about all unknowns, in their standard deviations, of a recording along samples (n, N) at
        `rate` Hz."""
        total, N = np.zeros((0, 0)), q.shape[1]
        for first in range(0, N, self.count):
            # The last batch is filled with samples that do not count.
            at = np.arange(first, first + self.count)
            clipped = np.minimum(at, N - 1)
            W = self._rows(self.outputs(q[:, clipped], qd[:, clipped], qdd[:, clipped]), self.count / rate)[at < N]
            flat = W.reshape(-1, W.shape[2])
            total = flat.T @ flat + (total if total.size else 0.0)
        return total

    def _rows(self, made: InstantOutputs, seconds: float) -> Array:
        """(N, n, P) columns of all unknowns in their standard deviations, over the noise."""
        W = np.concatenate([made.Y @ self.arms.spread, made.E * self.spreads], axis=2)
        return W * self._weight(seconds)

    def _weight(self, seconds: float) -> Array:
        return np.sqrt(ROWS_A_SECOND * seconds / self.count) / self.noise[:, None]

    def nats(self, made: InstantOutputs, seconds: float) -> tuple[float, Array, Array]:
        """Information of a recording of so many seconds that repeats these samples, beyond what is known, and its
        gradients by Y and E."""
        L = self.arms.spread
        W = self._rows(made, seconds)
        flat = W.reshape(-1, W.shape[2])
        before = np.eye(flat.shape[1]) + (0.0 if self.known is None else self.known)
        F = before + flat.T @ flat
        slope = (flat @ np.linalg.inv(F)).reshape(W.shape) * self._weight(seconds)
        value = float(np.linalg.slogdet(F)[1] - np.linalg.slogdet(before)[1]) / 2
        return value, slope[:, :, : L.shape[1]] @ L.T, slope[:, :, L.shape[1] :] * self.spreads

    def largest_torque(self, made: InstantOutputs) -> tuple[Array, Array, Array]:
        """(N, n) torque that hardly any possible arm exceeds, and what its gradients by Y (…, r) and E (…, m) need:
        Y spread and E spreads over their length."""
        shares_Y, shares_E = made.Y @ self.arms.spread, made.E * self.spreads
        length = np.sqrt((shares_Y**2).sum(axis=2) + (shares_E**2).sum(axis=2) + 1e-12)
        over = SURE_SPREADS / length[:, :, None]
        return np.abs(made.tau) + SURE_SPREADS * length, shares_Y * over, shares_E * over

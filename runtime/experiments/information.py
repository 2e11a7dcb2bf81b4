"""How much a motion tells of all unknown parameters of an arm at once, and the gradient of that by the motion.

The measure is the information in nats that a recording adds to what is known before: half of log det(1 + S F S), F the
information of the torques about the parameters and S the spread of possible arms. Its columns are the generated
regressor and the derivatives of the effects' torques, evaluated with their gradients by the generated CasADi functions.
Source: Sun & Ruiz 2016 and Swevers et al. 1997 (log det); Chaloner & Verdinelli 1995 (with what is known before).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from runtime.experiments.possible_arms import PossibleArms, upper
from runtime.experiments.settings import CORNER_RATE, FRICTION_SPREAD, ROWS_A_SECOND, SURE_SPREADS
from runtime.model import casadi_functions
from runtime.model.terms import Term, unknown_to_plan
from runtime.planning.blocks import Batch, Instructions, Machine
from runtime.planning.physics import Physics, PlanInstant

Array = NDArray[np.float64]


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
    """

    arms: PossibleArms
    count: int
    noise: Array

    @cached_property
    def terms(self) -> list[Term]:
        """The effects whose torque follows from the motion at one instant; others are left out of the search."""
        library = self.arms.model.library
        return [
            term
            for term in self.arms.values
            if not library[term.effect].states and not unknown_to_plan(library, term.effect)
        ]

    @cached_property
    def spreads(self) -> Array:
        """(m,) standard deviations of the effects' parameters, in the order of `terms`."""
        known = self.arms.values
        values = [casadi_functions.ordered(self.arms.model, t.effect, known[t]) for t in self.terms]
        return upper(FRICTION_SPREAD) * np.abs(np.concatenate([*values, [0.0]])[:-1])

    @cached_property
    def _batches(self) -> tuple[Batch, Batch]:
        """Outputs by q, qd, qdd; and the gradient of their weighted sum by the same."""
        model = self.arms.model
        physics = Physics(model, {term: self.arms.values[term] for term in self.terms}, {})
        values = physics.values(CORNER_RATE)
        q, qd, qdd = (ca.SX.sym(name, model.n) for name in ("q", "qd", "qdd"))
        free = {str(term): ca.SX.sym(f"p{k}", len(values[str(term)])) for k, term in enumerate(self.terms)}
        given = {name: ca.SX(ca.DM(values[name])) for name in ("struct", "width")}
        instant = PlanInstant(physics, q, qd, qdd, springs={}, p=(given | free).__getitem__, apart=False)
        parameters = ca.vertcat(*free.values())
        at = ca.DM([v for term in self.terms for v in values[str(term)]])
        tau, E = ca.Function("at", [q, qd, qdd, parameters], [instant.torque, ca.jacobian(instant.torque, parameters)])(
            q, qd, qdd, at
        )
        own = {"q": q, "qd": qd, "qdd": qdd}
        Y = casadi_functions.evaluate(model, "regressor", given["struct"], own.__getitem__)
        outputs = [ca.densify(Y), ca.densify(E), tau, ca.sumsqr(instant.tip_rate)]
        weights = [ca.SX.sym(f"w{k}", *output.shape) for k, output in enumerate(outputs)]
        total = sum(ca.dot(w, output) for w, output in zip(weights, outputs, strict=True))
        slopes = [ca.gradient(total, variable) for variable in (q, qd, qdd)]
        machine = Machine(model.library.machine)
        forward = Instructions.of(ca.Function("outputs", [q, qd, qdd], outputs))
        backward = Instructions.of(ca.Function("slopes", [q, qd, qdd, *weights], slopes))
        return Batch(machine, forward, self.count), Batch(machine, backward, self.count)

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

    def nats(self, made: InstantOutputs, seconds: float) -> tuple[float, Array, Array]:
        """Information of a recording of so many seconds that repeats these samples, and its gradients by Y and E."""
        L, spreads = self.arms.spread, self.spreads
        rows = np.sqrt(ROWS_A_SECOND * seconds / self.count) / self.noise[:, None]
        W = np.concatenate([made.Y @ L, made.E * spreads], axis=2) * rows
        flat = W.reshape(-1, W.shape[2])
        F = np.eye(flat.shape[1]) + flat.T @ flat
        slope = (flat @ np.linalg.inv(F)).reshape(W.shape) * rows
        value = float(np.linalg.slogdet(F)[1]) / 2
        return value, slope[:, :, : L.shape[1]] @ L.T, slope[:, :, L.shape[1] :] * spreads

    def largest_torque(self, made: InstantOutputs) -> tuple[Array, Array, Array]:
        """(N, n) torque that hardly any possible arm exceeds, and what its gradients by Y (…, r) and E (…, m) need:
        Y spread and E spreads over their length."""
        shares_Y, shares_E = made.Y @ self.arms.spread, made.E * self.spreads
        length = np.sqrt((shares_Y**2).sum(axis=2) + (shares_E**2).sum(axis=2) + 1e-12)
        over = SURE_SPREADS / length[:, :, None]
        return np.abs(made.tau) + SURE_SPREADS * length, shares_Y * over, shares_E * over

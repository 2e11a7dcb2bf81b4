"""What effects read along a motion, and the regressors that follow from it."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from runtime.model.loader import Model
from runtime.model.terms import Prediction, Term, joints_of
from runtime.motion.motion import Motion, Piece

Array = NDArray[np.float64]

DEFLECTION = "deflection"
"""The state of a transmission that a link-side encoder measures: motor less link."""

LEVEL_EFFECTS = ("coulomb", "coulomb_asymmetric", "stribeck")
"""The friction that a presliding bristle carries: g(q̇) of Canudas de Wit et al. 1995."""


PREDICTED = frozenset({"load", "link_inertia", "coupling", "level", "predicted", "predicted_rate", "plate_y"})
"""Signals that need an identified model; all others follow from the motion alone."""


@dataclass
class Signals:
    """The signals that effects read, along one piece, computed when first asked for.

    `prediction` is None as long as nothing is identified: then signals that need it are not there.
    """

    model: Model
    piece: Piece
    prediction: Prediction | None
    _cache: dict[tuple[str, int], Array | float] = field(default_factory=dict)

    def of(self, effect: str, joint: int) -> dict[str, Array | float]:
        """What the effect reads at a joint (0-based), and the time, which tells how many samples there are."""
        return {name: self.get(name, joint) for name in ("t", *self.model.library.effects[effect].signals)}

    def get(self, name: str, joint: int) -> Array | float:
        key = (name, joint)
        if key not in self._cache:
            self._cache[key] = _READERS[name](self, joint)
        return self._cache[key]

    @cached_property
    def measured(self) -> Array | None:
        """(n, N) the part of the rigid arm's torque that needs no inertial parameter: all of it where the user's own
        model gives it, else that which holds a measured force f at the end-effector, −Jᵀ f; None without either."""
        sensors = self.piece.sensors
        if sensors.tau_rigid is not None:
            return sensors.tau_rigid
        if sensors.force is not None:
            return -np.einsum("cjt,ct->jt", self.tip_jacobian[:2], sensors.force)
        return None

    @cached_property
    def rigid(self) -> Array:
        """(n, N) D qdd + C qd + g with the identified inertial parameters, less Jᵀ f of a measured force; or the
        user's own model's."""
        p = self.piece
        if p.sensors.tau_rigid is not None:
            return p.sensors.tau_rigid
        rigid = self.model.inverse_dynamics(p.q, p.qd, p.qdd, self._known.lumps)
        return rigid if self.measured is None else rigid + self.measured

    @cached_property
    def _loads(self) -> Array:
        """(n, N) the same without the rotors, of accelerations that are motion and not noise.

        What is simulated under a load amplifies noise at its resonance, and magnitudes do not average it.
        """
        p = self.piece
        rotors = np.array([[joint.rotor_inertia] for joint in self.model.joints])
        if p.sensors.tau_rigid is not None:
            whole = np.array([smooth(row) for smooth, row in zip(p.excited, p.sensors.tau_rigid, strict=True)])
            return whole - rotors * p.slow
        loads = self.model.inverse_dynamics(p.q, p.qd, p.slow, self._known.lumps) - rotors * p.slow
        return loads if self.measured is None else loads + self.measured

    @property
    def _known(self) -> Prediction:
        if self.prediction is None:
            raise RuntimeError("this signal needs an identified model")
        return self.prediction

    @cached_property
    def tip(self) -> Array:
        return self.model.tip(self.piece.q)

    @cached_property
    def tip_jacobian(self) -> Array:
        return self.model.tip_jacobian(self.piece.q)

    @cached_property
    def tip_loads(self) -> Array:
        return self.model.tip_load(self.piece.q, self.piece.qd, self.piece.qdd)

    @cached_property
    def moments(self) -> Array:
        return self.model.moment_jacobian(self.piece.q)

    @cached_property
    def _inertia(self) -> Array:
        return self.model.inertia(self.piece.q, self._known.lumps)

    def link_inertia(self, joint: int) -> Array:
        return self._inertia[joint, joint] - self.model.joints[joint].rotor_inertia

    def coupling(self, joint: int, own: int) -> Array:
        """(N,) inertia between two joints (0-based), link side: the signal of that name."""
        return self.link_inertia(own) if joint == own else self._inertia[joint, own]

    def plate(self) -> float:
        return self._known.values.get(Term("plate"), {}).get("position", -np.inf)

    def level(self, joint: int) -> Array:
        total = np.zeros_like(self.piece.t)
        for effect in LEVEL_EFFECTS:
            term = Term(effect, joint + 1)
            if term in self._known.values:
                total += self.torque(term, joint)
        return np.abs(total)

    def predicted(self, joint: int) -> Array:
        total = self.rigid[joint].copy()
        for term in self._known.values:
            if joint in joints_of(self.model, term) and "predicted" not in self._reads(term):
                total += self.torque(term, joint)
        return total

    def _reads(self, term: Term) -> str:
        return " ".join(self.model.library.effects[term.effect].signals)

    def torque(self, term: Term, joint: int) -> Array:
        """(N,) torque of a term of the prediction at a joint (0-based)."""
        values = self._known.values[term]
        return self.model.library.torque(term.effect, self.term_signals(term, joint), values, self.piece.dt)

    def deflection(self, term: Term, shape: Mapping[str, float]) -> Array | None:
        """(N,) by which a term's link lags behind its motor; None for a term without such a state."""
        if term.joint is None or DEFLECTION not in self.model.library.effects[term.effect].states:
            return None
        read = self.term_signals(term, term.joint - 1)
        return self.model.library.states(term.effect, read, shape, self.piece.dt)[DEFLECTION]

    def term_signals(self, term: Term, joint: int) -> dict[str, Array | float]:
        """As `of`, with the place of the joint in a pair of joints, or its coupling to the term's own."""
        if "coupling" in self.model.library.effects[term.effect].signals and term.joint is not None:
            return {**self.of(term.effect, term.joint - 1), "coupling": self.coupling(joint, term.joint - 1)}
        signals = self.of(term.effect, joint)
        if "has_next" in signals:
            signals["has_next"] = 1.0 if term.joint is not None and joint == term.joint - 1 else 0.0
        return signals


_READERS: dict[str, Callable[[Signals, int], Array | float]] = {
    "q": lambda s, i: s.piece.q[i],
    "qd": lambda s, i: s.piece.qd[i],
    "qdd": lambda s, i: s.piece.qdd[i],
    "t": lambda s, _: s.piece.t,
    "load": lambda s, i: s._loads[i],
    "link_inertia": lambda s, i: s.link_inertia(i),
    "coupling": lambda s, i: s.link_inertia(i),
    "level": lambda s, i: s.level(i),
    "predicted": lambda s, i: s.predicted(i),
    "predicted_rate": lambda s, i: np.gradient(np.asarray(s.get("predicted", i)), s.piece.dt),
    "warmth": lambda s, i: s.piece.warmth[i],
    "unmeasured": lambda s, i: 0.0 if s.piece.measured[i] else 1.0,
    "qd_next": lambda s, i: s.piece.qd[i + 1] if i + 1 < s.model.n else 0.0,
    "qd_previous": lambda s, i: s.piece.qd[i - 1] if i else 0.0,
    "has_next": lambda _, __: 1.0,
    "moment_x": lambda s, i: s.moments[0, i],
    "moment_y": lambda s, i: s.moments[1, i],
    "tip_load": lambda s, i: s.tip_loads[i],
    "tip_y": lambda s, _: s.tip[1],
    "tip_yd": lambda s, _: np.sum(s.tip_jacobian[1] * s.piece.qd, axis=0),
    "tip_row": lambda s, i: s.tip_jacobian[1, i],
    "plate_y": lambda s, _: s.plate(),
    "ratio": lambda s, i: s.model.joints[i].gear_ratio,
}


@dataclass
class Regressors:
    """In-band regressors of one model along one motion; asked for again, they are not computed again.

    extents: offset and scale of quantities over the motion, as `grids` has found them.
    """

    model: Model
    motion: Motion
    prediction: Prediction | None = None
    extents: dict[tuple[str, tuple[int, ...]], tuple[float, float]] = field(default_factory=dict)
    _columns: dict[tuple[Hashable, ...], Array] = field(default_factory=dict)

    @cached_property
    def signals(self) -> tuple[Signals, ...]:
        return tuple(Signals(self.model, piece, self.prediction) for piece in self.motion.pieces)

    @cached_property
    def perturbed(self) -> Regressors:
        """The same along the motion with a further realisation of the encoders' noise on it."""
        return Regressors(self.model, self.motion.perturbed, self.prediction)

    def _kept(self, key: tuple[Hashable, ...], of_motion: bool, make: Callable[[], Array]) -> Array:
        """What `make` gives, computed once: for this motion if it depends on nothing else, or for these regressors."""
        store = self.motion.columns if of_motion else self._columns
        if key not in store:
            store[key] = make()
        return store[key]

    def rigid(self, joint: int) -> Array:
        """(p, M) derivative of the joint's torque (0-based) by the base inertial parameters; zero where the user's own
        model gives it whole."""

        def make() -> Array:
            if self.motion.rigid_given:
                return np.zeros((self.model.n, len(self.model.lumps), len(self.motion.row_piece)))
            parts = [p.in_band(self.model.regressor(p.q, p.qd, p.qdd)) for p in self.motion.pieces]
            return np.concatenate(parts, axis=2)

        return self._kept(("rigid", self.model.directory), True, make)[joint]

    def measured(self, joint: int) -> Array:
        """(M,) the part of the joint's torque (0-based) that measured signals give, whatever the parameters."""

        def make() -> Array:
            parts = [
                np.zeros((self.model.n, len(p.centres))) if s.measured is None else p.in_band(s.measured)
                for s, p in zip(self.signals, self.motion.pieces, strict=True)
            ]
            return np.concatenate(parts, axis=1)

        return self._kept(("measured", self.model.directory), True, make)[joint]

    def columns(self, term: Term, joint: int, shape: Mapping[str, float]) -> Array:
        """(1 + k, M): the part without free coefficient, then one row a linear coefficient."""

        def make() -> Array:
            rows = [
                p.in_band(self.raw_columns(s, term, joint, shape))
                for s, p in zip(self.signals, self.motion.pieces, strict=True)
            ]
            return np.concatenate(rows, axis=1)

        library = self.model.library
        of_motion = not PREDICTED & set(library.effects[term.effect].signals)
        return self._kept((library.directory, self.model.directory, term, joint, *shape.values()), of_motion, make)

    def raw_columns(self, signals: Signals, term: Term, joint: int, shape: Mapping[str, float]) -> Array:
        """(1 + k, N) at full rate along one piece."""
        library = self.model.library
        return library.columns(term.effect, signals.term_signals(term, joint), shape, signals.piece.dt)

    def skew(self, joint: int) -> Array:
        """(M,) change of the in-band torque when it is taken one sample later."""
        late, early = self.motion.torque(joint, 0.5), self.motion.torque(joint, -0.5)
        return late - early

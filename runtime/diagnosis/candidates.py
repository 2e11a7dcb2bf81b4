"""Every effect of the library as a candidate for what a fitted model lacks.

A candidate is a block of columns with a grid over its shape parameters. The base model's coefficients,
the linearised shape parameters and the skew stay free beside it, so that a candidate gets credit only
for torque that the base cannot produce. All joints' rows count together: what one joint's torque says of
the inertia that joints share, another's may contradict. Shapes are searched on an excerpt of a long
motion and judged on the whole.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from runtime.arrays import Array
from runtime.diagnosis.gates import GateResult, failed
from runtime.diagnosis.score import NOT_WEIGHED, Evidence, price
from runtime.diagnosis.settings import MOST_FINDINGS
from runtime.identification import grids
from runtime.identification.fit import Fit, smoothing_change
from runtime.identification.grids import motor_angle
from runtime.identification.problem import change
from runtime.identification.recorded_torque import LINK_LOAD
from runtime.identification.regressors import Regressors
from runtime.model.terms import Term, Values, joints_of, known_vector, reads_arm
from runtime.motion.settings import SOME
from runtime.regression.rows import Block, Columns, JointRows
from runtime.regression.system import LinearSystem


@dataclass(frozen=True)
class TwistResidual:
    """What a link-side encoder shows of a candidate that the motor torque does not, RMS: what is unexplained of the
    twist without and with it, and what only it explains there; unit of the joint's position."""

    before: float
    after: float
    eff: float
    unit: str


@dataclass(frozen=True, eq=False)
class Candidate:
    """A term at its best shape, and what the gates say of it once it was weighed.

    searched    number of shape parameters that were searched      among  of places among which the shape was chosen
    predicted   whether its values are what the model file predicts: then they are no unknowns; None: it predicts none
    fall        of the squared error on the excerpt
    edge        distance of the shape from an end of what was searched, part of the stretch
    eff         RMS torque that only it explains, N m (N)
    alone       whether no other law comes near it at its joints
    twist       set where a link-side encoder's rows were weighed in the place of the torque's: then eff is 0
    evidence    what speaks for it beside the fitted model     results  of the gates, in their order
    """

    term: Term
    shape: Values
    searched: int
    fall: float
    edge: float
    among: int = 1
    predicted: bool | None = None
    eff: float = 0.0
    alone: bool = False
    twist: TwistResidual | None = None
    evidence: Evidence = NOT_WEIGHED
    results: tuple[GateResult, ...] = ()

    @property
    def failed(self) -> tuple[GateResult, ...]:
        """Results of the gates that stay closed."""
        return failed(self.results)

    @property
    def passes(self) -> bool:
        """Whether all gates are open."""
        return not self.failed


@dataclass
class FittedBase:
    """A fitted model as the base to which candidates are added."""

    fit: Fit

    def __post_init__(self) -> None:
        self.model, self.motion, self.problem = self.fit.model, self.fit.motion, self.fit.problem
        self.regressors = Regressors(self.model, self.motion, self.fit.prediction, self.fit.ahead)

    def known(self) -> tuple[Term, ...]:
        """What the model has: of the torque, and what a further sensor has shown."""
        return (*self.problem.layout.terms, *self.fit.witnessed)

    def terms(self) -> list[Term]:
        """What could be missing at any joint, in the arm or in the contact."""
        active = set(self.known())
        covered = {replace(t, effect=g) for t in active for g in self.model.library.effects[t.effect].generalises}
        found = []
        for name, info in self.model.library.effects.items():
            last = self.model.n - (info.scope == "joints")
            places = range(1, last + 1) if info.scope in ("joint", "joints") else (None,)
            if info.scope == "contact" and self.model.contact is None:
                continue
            terms = [self._next(Term(name, place)) if info.several else Term(name, place) for place in places]
            new = (t for t in terms if t not in active and t not in covered and t.number <= MOST_FINDINGS)
            found += [t for t in new if self._possible(t)]
        return found

    def _next(self, term: Term) -> Term:
        while term in self.problem.layout.terms:
            term = replace(term, number=term.number + 1)
        return term

    def _possible(self, term: Term) -> bool:
        moving = [i for i in joints_of(self.model, term) if self.motion.moving(i).any()]
        if joints_of(self.model, term)[0] not in moving:
            return False
        if self.model.library.effects[term.effect].alike_at_joints and len(moving) < 2:
            return False
        if "torque_rate" in self.model.library.needs[term.effect] and self.fit.skew_free:
            # A hold explains the shift between torque and motion, the same at all joints: nothing is left to find.
            return False
        if self.motion.rigid_given and reads_arm(self.model.library, term.effect, known=LINK_LOAD):
            # The rigid-body torque is the user's own: what the file says of the arm is not meant.
            return False
        return not self.regressors.signals((term.joint or 1) - 1)[0].lacks(term)

    @cached_property
    def system(self) -> LinearSystem:
        """The fitted model's equations at all joints, each weighted by its own residual.

        Beside what is linear, its shapes may change to first order, and the skew and the smoothing of a load.
        """
        system, smoothed = self.fit.linearised, smoothing_change(self.fit)
        if smoothed:
            # Between the load that is smoothed and the one that is not lies the truth.
            system = system.with_block(change("smoothing", smoothed, 0.0, 1.0))
        return system.over([self._rows(i, rows) for i, rows in enumerate(system.joints)])

    def _rows(self, joint: int, rows: JointRows) -> JointRows:
        rms = self.rms(joint)
        return replace(rows, weight=1 / rms if rms else 0.0)

    def rms(self, joint: int) -> float:
        """Of the fitted model's residual at a joint (0-based)."""
        return self._rms[joint]

    @cached_property
    def _rms(self) -> list[float]:
        used = [left[self.motion.moving(i)] for i, left in enumerate(self.fit.residual)]
        return [float(np.sqrt(np.mean(left**2))) if len(left) else 0.0 for left in used]

    def torque(self, joint: int) -> float:
        """RMS of the recorded torque at a joint (0-based)."""
        recorded = self.motion.recorded(joint, self.fit.skew)[self.motion.moving(joint)]
        return float(np.sqrt(np.mean(recorded**2))) if len(recorded) else 0.0

    def unknowns(self, term: Term, searched: int, predicted: bool | None = None) -> int:
        """How many more there are with a term. What the model file predicts the size of has none of its own."""
        info, effects = self.model.library.effects[term.effect], self.model.library.effects
        own = searched + (0 if info.sized or predicted else len(info.coefficients))
        return max(own - sum(len(effects[t.effect].coefficients) for t in self.replaced(term)), 0)

    def predicted(self, term: Term, coefficients: Array) -> bool | None:
        """Whether these are what the masses of the model file predict, as far as they are right: a vector that the term
        changes has its known size. None: the file predicts nothing of it."""
        vector = known_vector(self.model, term)
        if vector is None:
            return None
        stated, size = vector
        # Masses of a model file are right to 5 to 20 %.
        return bool(abs(np.linalg.norm(stated + coefficients) - size) < SOME * size)

    def price(self, term: Term, searched: int, among: int, rows: int, predicted: bool | None = None) -> float:
        """What a term's score must exceed, sought at every joint and `among` places of its shape; rows: independent
        ones."""
        places = 1 if term.joint is None else self.model.n
        return price(places * among, self.unknowns(term, searched, predicted), rows)

    @property
    def _excerpt_samples(self) -> int:
        # Time: verdicts on longer excerpts are the same.
        return round(60_000 / self.model.n**0.5)

    @cached_property
    def excerpt(self) -> tuple[Regressors, LinearSystem]:
        """Regressors and equations on the excerpt on which shapes are searched."""
        motion, places = self.motion.excerpt(self._excerpt_samples)
        if motion is self.motion:
            return self.regressors, self.system
        joints = []
        for i, (rows, at) in enumerate(zip(self.system.joints, places, strict=True)):
            use = rows.use[at] & motion.moving(i)
            joints.append(
                JointRows(
                    rows.tau[at],
                    use,
                    motion.row_piece(i),
                    weight=rows.weight,
                    eliminated=motion.eliminated(i),
                    unaffected=rows.use[at] & motion.unaffected(i),
                    dependent=motion.dependent(i, use),
                )
            )
        regressors = Regressors(self.model, motion, self.fit.prediction, self.fit.ahead)
        return regressors, self.system.restricted(joints, places)

    def replaced(self, term: Term) -> tuple[Term, ...]:
        """Active terms that the candidate contains as special cases."""
        generalises = self.model.library.effects[term.effect].generalises
        return tuple(t for t in self.problem.layout.terms if t.effect in generalises and t.joint == term.joint)

    def without(self, system: LinearSystem, terms: tuple[Term, ...]) -> LinearSystem:
        """A system of this base without all that belongs to these terms."""
        changes = [of for of in self.problem.searched(self.fit.shapes) if of.term in terms]
        return system.without([*terms, *changes])

    def block(self, term: Term, shape: Values) -> Block:
        """The candidate's columns on all joints on which it acts, with their noise."""
        parts = {}
        for i in joints_of(self.model, term):
            columns = self.regressors.columns(term, i, shape)
            parts[i] = Columns(columns, _apart(self.regressors.perturbed.columns(term, i, shape), columns))
        return self._bounded(term, parts)

    def _bounded(self, term: Term, parts: dict[int, Columns]) -> Block:
        coefficients = self.model.library.effects[term.effect].coefficients
        bounds = np.array([c.bounds for c in coefficients], dtype=float).reshape(-1, 2)
        return Block(term, parts, bounds[:, 0], bounds[:, 1])

    def watched(self, term: Term) -> bool:
        """Whether it is a transmission with an encoder on either side."""
        return self.model.library.effects[term.effect].gives_way and self.motion.has(
            "twist", joints_of(self.model, term)[0]
        )

    def trial(self, term: Term, shape: Values) -> Block:
        """The candidate's columns on the excerpt."""
        return self._trials(term, [shape]).choice(0)

    def _trials(self, term: Term, shapes: Sequence[Values]) -> Block:
        """`trial` of many shapes."""
        joints = joints_of(self.model, term)
        if not self.model.library.effects[term.effect].gives_way:
            return self._sampled(term, shapes, joints, reread=False)
        # A transmission's torque is a further derivative of the same readings: their noise would speak against any
        # stiffness. A gap meets its flanks elsewhere on another reading: that noise is no smaller error that adds up.
        linear = not self.model.library.effects[term.effect].has_gap
        return self._sampled(term, shapes, joints, reread=self.watched(term) or linear)

    @cached_property
    def _reread(self) -> Regressors:
        if self.excerpt[0] is self.regressors:
            return self.regressors.perturbed
        reread = self.motion.perturbed.excerpt(self._excerpt_samples)[0]
        return Regressors(self.model, reread, self.fit.prediction, self.fit.ahead)

    def samples(self, term: Term, shapes: Sequence[Values]) -> Block:
        """As `block`, on the excerpt, of many shapes."""
        return self._sampled(term, shapes, joints_of(self.model, term), reread=True)

    def unread(self, term: Term, shapes: Sequence[Values]) -> Block:
        """As `samples`, without the encoders' noise."""
        return self._sampled(term, shapes, joints_of(self.model, term), reread=False)

    def _sampled(self, term: Term, shapes: Sequence[Values], joints: tuple[int, ...], reread: bool) -> Block:
        parts = {}
        for i in joints:
            columns = self.excerpt[0].columns_each(term, i, shapes)
            again = self._reread.columns_each(term, i, shapes) if reread else None
            parts[i] = Columns(columns, None if again is None else _apart(again, columns))
        return self._bounded(term, parts)

    def _gain(self, system: LinearSystem, term: Term, shape: Values) -> float:
        return float(self._gains(system, term, [shape])[0])

    def _gains(self, system: LinearSystem, term: Term, shapes: Sequence[Values]) -> Array:
        """(S,) by how much the candidate lowers the squared error, quickly; minus infinity where it is no number."""
        found = np.full(len(shapes), -np.inf)
        if len(shapes):
            blocks = self._trials(term, shapes)
            finite = blocks.finite
            if finite.any():
                found[finite] = system.gains(blocks if finite.all() else blocks.choice(finite))
        return found

    def search(self, term: Term, beside: LinearSystem | None = None) -> Candidate | None:
        """The candidate at the best point of its grid; None if the data give it no scale or no say.

        beside: another system on the excerpt, with more in it.
        """
        regressors, system = self.excerpt
        whole = beside or system
        system = self.without(whole, self.replaced(term))
        choices = self.choices(term)
        gains = self._gains(system, term, choices).tolist()
        scored = sorted(((gain, k) for k, gain in enumerate(gains)), reverse=True)
        if not scored or not np.isfinite(scored[0][0]):
            return None
        if len(scored) > 1:
            # The quick gain lets the base's friction turn negative; of the best few, it is seen who needs that.
            few = [(k, gain) for gain, k in scored[:4] if np.isfinite(gain)]
            scored = [max((self._exact(system, term, choices[k], gain), k) for k, gain in few)]
        gain, chosen = scored[0]
        shape = choices[chosen]
        searched = len(self.model.library.effects[term.effect].shape) if len(choices) > 1 else 0
        edge = grids.edge_distance(regressors, term, shape) if len(choices) > 1 else np.inf
        # What it replaces would have explained something, too.
        gain -= system.sse - whole.sse if system is not whole else 0.0
        return Candidate(term, shape, searched, fall=gain, edge=edge, among=max(self._lines(term)[1], len(choices)))

    def best_of(self, term: Term, choices: Sequence[Values]) -> Candidate:
        """The candidate at that of some shapes which lowers the squared error most."""
        system = self.without(self.excerpt[1], self.replaced(term))
        gain, k = max((gain, k) for k, gain in enumerate(self._gains(system, term, choices).tolist()))
        return Candidate(term, choices[k], len(choices[k]), fall=gain, edge=np.inf)

    def each(self, term: Term) -> list[Candidate]:
        """A candidate at every shape at which the term is tried, refined."""
        system, choices, among = self.excerpt[1], self.choices(term), self._lines(term)[1]
        searched = len(self.model.library.effects[term.effect].shape)
        gains = zip(choices, self._gains(system, term, choices).tolist(), strict=True)
        falls = [(c, self._exact(system, term, c, gain)) for c, gain in gains]
        return [self.refine(Candidate(term, c, searched, fall=x, edge=np.inf, among=among)) for c, x in falls]

    def _exact(self, system: LinearSystem, term: Term, shape: Values, gain: float) -> float:
        """The fall of the squared error with every coefficient within its bounds; none of columns without a quick gain,
        hardly more than their noise, whose compensated squares no error can be told from."""
        return system.sse - system.with_block(self.trial(term, shape)).sse if gain > 0 else 0.0

    def choices(self, term: Term) -> list[Values]:
        """Shapes at which the term is tried; of a line over the motor's angle, where the residual has one."""
        choices = grids.points(self.excerpt[0], term, self._lines(term)[0])
        warms = "temperature" in self.model.library.needs[term.effect]
        if warms and all(bool(p.measured.all()) for p in self.motion.pieces):
            # The measured temperature takes the place of the assumed warming: its time constant is idle.
            return choices[:1]
        return choices

    def _lines(self, term: Term) -> tuple[Array | None, int]:
        """Orders at which a line over the motor's angle is tried, and among how many those of the residual stand out;
        None and 1 for a term that is no line."""
        if self.model.library.effects[term.effect].line is None:
            return None, 1
        joint = joints_of(self.model, term)[0]
        if joint not in self._found_lines:
            angle = motor_angle(self.model, self.motion, joint)
            found, among = angle.lines(*self.system.beside(joint))
            self._found_lines[joint] = angle.with_turns(found), among
        return self._found_lines[joint]

    @cached_property
    def _found_lines(self) -> dict[int, tuple[Array, int]]:
        return {}

    def anywhere(self, term: Term) -> list[Values]:
        """Shapes at which the term could be hidden; of a line, all over the orders that the motion shows."""
        of_line = self.model.library.effects[term.effect].line is not None
        return grids.points(self.excerpt[0], term) if of_line else self.choices(term)

    def refine(self, candidate: Candidate) -> Candidate:
        """The same candidate with its shape moved off the grid to the least error."""
        if not candidate.searched:
            return candidate
        term, system = candidate.term, self.without(self.excerpt[1], self.replaced(candidate.term))
        moving = self.moving(term)
        if not moving:
            return candidate
        start = np.array([candidate.shape[name] for name in moving])
        scale = np.array([self.grid_step(candidate, name) for name in moving])
        logarithmic = self.logarithmic(term)
        own = self._gain(system, term, candidate.shape)
        best = (own, candidate.shape)

        def error(z: Array) -> float:
            nonlocal best
            moved = start * np.exp(z * scale) if logarithmic else start + z * scale
            shape = {**candidate.shape, **dict(zip(moving, map(float, moved), strict=True))}
            if not grids.within(self.excerpt[0], term, shape):
                return float("inf")
            gain = self._gain(system, term, shape)
            best = max(best, (gain, shape), key=lambda item: item[0])
            return -gain

        _search_beside_grid(error, len(moving))
        there, here = (self._exact(system, term, shape, gain) for gain, shape in (best, (own, candidate.shape)))
        if there <= here:
            return candidate
        edge = grids.edge_distance(self.excerpt[0], term, best[1])
        return replace(candidate, shape=best[1], fall=candidate.fall + there - here, edge=edge)

    def moving(self, term: Term) -> list[str]:
        """Shape parameters between whose grid values there are others."""
        shape = self.model.library.effects[term.effect].shape
        return [p.name for p in shape if p.grid and p.grid.continuous]

    def logarithmic(self, term: Term) -> bool:
        """Whether all of the term's shapes are searched on a logarithmic grid."""
        shape = self.model.library.effects[term.effect].shape
        return all(p.grid is None or p.grid.spacing == "log" for p in shape)

    def grid_step(self, candidate: Candidate, name: str) -> float:
        """One grid step of a shape parameter: as a ratio's logarithm on logarithmic grids."""
        parameter = self.model.library.effects[candidate.term.effect].parameter(name)
        values = grids.axis(self.excerpt[0], candidate.term, parameter, candidate.shape)
        if self.logarithmic(candidate.term):
            return float(np.log(values[1] / values[0]))
        # Moments between which runs end stand closer.
        return float(np.median(np.diff(values)))


def _apart(one: Array, other: Array) -> Array:
    with np.errstate(invalid="ignore"):
        return one - other


def _search_beside_grid(error: Callable[[Array], float], count: int) -> None:
    """Nelder and Mead's simplex over z (count,), in steps of the grid from one of its points."""
    from scipy.optimize import minimize  # where it is used: it takes longer to load than a fit

    reach, start = 1.5, 0.5 * np.eye(count)  # not beyond the neighbours, which were tried; halfway there

    def inside(z: Array) -> float:
        return error(z) if np.all(np.abs(z) <= reach) else float("inf")

    # It has come to rest after 14 evaluations a parameter; a place that is finer changes no verdict.
    ends = {"maxfev": 14 * count, "xatol": 0.02, "fatol": 0.0}
    begin = np.zeros(count)
    minimize(inside, begin, method="Nelder-Mead", options={**ends, "initial_simplex": np.vstack([begin, start])})

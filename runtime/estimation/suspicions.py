"""Wrong data, told by a fit: another sign, degrees read as radians, a missing gear ratio, exchanged joints.

A hypothesis is refitted with the data put right. It is a suspicion where the torque is then explained far better, or,
where no fit can tell (an inertia and a friction that are all too small by one factor fit as well), where the inertia
comes to the model file's. A model that merely lacks an effect is explained no better by any of them: friction takes
power and a D(q) is positive definite, whatever else acts.

Source: Siciliano, Sciavicco, Villani & Oriolo, Robotics, 2009, chapter 7, for both properties.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations, product
from math import isfinite, log, pi

import numpy as np
from numpy.typing import NDArray

from runtime.estimation.identify import Identification
from runtime.estimation.least_squares import bounded
from runtime.estimation.problem import Problem, least_inertia
from runtime.estimation.settings import (
    EXCHANGED_FALLS_TO,
    FACTOR_OF_INERTIA,
    LEAST_TELLING_RATIO,
    SUSPECTED_FROM,
    SUSPICION_SAMPLES,
    TURNED_FALLS_TO,
)
from runtime.motion.motion import Motion, Piece
from runtime.recordings.cures import in_unit, read_from, turned_round
from runtime.recordings.units import UNITS

Array = NDArray[np.float64]

DEGREE = UNITS["deg"][1]
"""rad."""
MILLI = UNITS["mA"][1]


@dataclass(frozen=True)
class Suspicion:
    """Something about the data that must be put right first. joint: 1-based; kind: in a word; cure: what to type."""

    joint: int
    kind: str
    found: str
    cure: str

    def __str__(self) -> str:
        return f"joint {self.joint}: {self.found}; {self.cure}"


def suspicions(identification: Identification) -> tuple[Suspicion, ...]:
    """What a fit of the model file's structure says of its recordings; empty where they can be believed."""
    motion = identification.motion
    able = [i for i in range(motion.n) if motion.moving(i).any()]
    if motion.rigid_given or not able:
        return ()
    factors = _by_factor(identification, able)
    if not _doubtful(identification, able):
        return tuple(factors)
    trials = _Trials(identification, able)
    return tuple(trials.turned() or trials.degrees() or trials.exchanged() or factors)


def doubts(identification: Identification) -> tuple[Suspicion, ...]:
    """What the errors alone say of data that ask for an inertia that no arm has; empty where they do not.

    An effect that is missing at one joint, a wrist's coupled gear, spoils the inertia of every trial, and with it the
    surer test of `suspicions`. For people to look at: no verdict rests on it.
    """
    motion = identification.motion
    able = [i for i in range(motion.n) if motion.moving(i).any()]
    if motion.rigid_given or not able or not _doubtful(identification, able):
        return ()
    if not _Trials(identification, able).impossible_as_given():
        return ()
    trials = _LooseTrials(identification, able)
    return tuple(trials.exchanged() or trials.degrees() or trials.turned())


def relative_errors(motion: Motion, residual: Sequence[Array], skew: float) -> Array:
    """(n,) ‖τ − τ̂‖/‖τ‖ of every joint on its rows that count; 0 where there are none."""
    found = np.zeros(motion.n)
    for i in range(motion.n):
        use = motion.moving(i)
        total = float(np.linalg.norm(motion.torque(i, skew)[use]))
        found[i] = float(np.linalg.norm(residual[i][use])) / total if total else 0.0
    return found


def _doubtful(identification: Identification, able: Sequence[int]) -> bool:
    """Whether the fit leaves enough of some joint's torque, or stopped at a bound, for wrong data to be behind it."""
    fit, layout = identification.fit, identification.problem.layout
    errors = relative_errors(identification.motion, fit.residual, fit.skew)
    terms = [layout.slices[t] for t in layout.terms if t.joint and t.joint - 1 in able]
    idle = any(part.stop > part.start and not fit.coefficients[part].any() for part in terms)
    return idle or float(errors[list(able)].max()) > SUSPECTED_FROM


Equations = dict[int, tuple[Array, Array]]
"""Of each joint (0-based) that counts: regressor (K, m) and the part without free coefficient (m,)."""


class _Trials:
    """The structure, refitted on an excerpt with data that are put right in one way after another.

    A trial's inertia is free, so that it costs one small system; that of the best must be positive definite.
    """

    def __init__(self, identification: Identification, able: Sequence[int]) -> None:
        self.model, self.fit, self.able = identification.model, identification.fit, able
        self.terms = identification.problem.layout.terms
        self.prediction = identification.problem.regressors.prediction
        self.motion, _ = identification.motion.excerpt(SUSPICION_SAMPLES)
        self.problem = Problem(self.model, self.motion, self.terms, self.prediction)
        # A trial weighs the joints by their torques, and where the fit's other weights make a joint pay for its
        # neighbours, that alone lowers its error.
        fitted = relative_errors(identification.motion, self.fit.residual, self.fit.skew)
        self.as_given = np.minimum(fitted, self._errors(self.motion, self._equations))

    @cached_property
    def _equations(self) -> Equations:
        return self._equations_of(self.problem)

    def _equations_of(self, problem: Problem) -> Equations:
        found = {}
        for i in self.able:
            use = problem.motion.moving(i)
            x, fixed = problem.rows(i, self.fit.shapes)
            found[i] = x[:, use], fixed[use]
        return found

    def _errors(self, motion: Motion, equations: Equations) -> Array:
        """(n,) relative errors, every joint weighted by its torque; infinite where no arm has such an inertia."""
        layout = self.problem.layout
        gram, moment, rows = np.zeros((layout.size, layout.size)), np.zeros(layout.size), {}
        for i, (x, fixed) in equations.items():
            tau = motion.torque(i, self.fit.skew)[motion.moving(i)]
            size = float(np.linalg.norm(tau))
            rows[i] = x / size, (tau - fixed) / size
            gram += rows[i][0] @ rows[i][0].T
            moment += rows[i][0] @ rows[i][1]
        theta = bounded(gram, moment, layout.lower, layout.upper, layout.stated)
        if not self._possible(motion, theta[layout.lumps]):
            return np.full(motion.n, np.inf)
        errors = np.zeros(motion.n)
        for i, (x, y) in rows.items():
            errors[i] = float(np.linalg.norm(y - theta @ x))
        return errors

    def _possible(self, motion: Motion, lumps: Array) -> bool:
        """Whether an arm can have such an inertia."""
        return least_inertia(self.model, motion, lumps)[0] > 0

    def impossible_as_given(self) -> bool:
        """Whether the data as they are ask for an inertia that no arm has."""
        return bool(np.isinf(self._errors(self.motion, self._equations)).any())

    def _with_torques(self, mix: Array) -> Array:
        """(n,) relative errors with torques mix (n, n) @ tau."""
        return self._errors(_changed(self.motion, lambda p: replace(p, tau=mix @ p.tau)), self._equations)

    def _with_positions(self, mix: Array, torques: Array) -> Array:
        """(n,) relative errors with positions mix (n, n) @ q and torques (n, n) @ tau."""

        def change(p: Piece) -> Piece:
            moved = [mix @ x for x in (p.q, p.qd, p.qdd, p.slow)]
            return replace(p, q=moved[0], qd=moved[1], qdd=moved[2], slow=moved[3], tau=torques @ p.tau)

        standing = np.where(np.isinf(self.motion.standstill), 0.0, self.motion.standstill)
        standstill = np.where(np.isinf(self.motion.standstill), np.inf, mix @ standing)
        motion = _changed(self.motion, change).resting(standstill, self.motion.quiet)
        return self._errors(motion, self._equations_of(Problem(self.model, motion, self.terms, self.prediction)))

    def _whole(self, errors: Array) -> float:
        return float(np.mean(errors[list(self.able)] ** 2))

    def turned(self) -> list[Suspicion]:
        """Joints whose torque has the other sign than what they need to move so."""
        signs, errors = np.ones(self.motion.n), self.as_given
        for joints in [list(self.able), *([i] for i in self.able if len(self.able) > 1)]:
            trial = signs.copy()
            trial[joints] *= -1
            found = self._with_torques(np.diag(trial))
            if np.all(found[joints] < TURNED_FALLS_TO * errors[joints]) and self._whole(found) < self._whole(errors):
                signs, errors = trial, found
        return [
            Suspicion(
                i + 1,
                "sign",
                f"its torque has the wrong sign: as recorded the best fit misses {100 * self.as_given[i]:.3g} % of it, "
                f"turned round {100 * errors[i]:.3g} %",
                "expected positive where it drives towards positive positions: pass "
                f"{turned_round(self.motion.cells, f'tau{i + 1}')}",
            )
            for i in self.able
            if signs[i] < 0
        ]

    def degrees(self) -> list[Suspicion]:
        """Joints whose positions, converted from degrees, are explained far better."""
        wide = [i for i in self.able if _turns(self.motion, i) > 1 and self.model.joints[i].type == "revolute"]
        for joints in [wide, *([i] for i in wide)] if len(wide) > 1 else [wide] if wide else []:
            factor = np.ones(self.motion.n)
            factor[joints] = DEGREE
            errors = self._with_positions(np.diag(factor), np.eye(self.motion.n))
            better = self._whole(errors) < self._whole(self.as_given)
            if better and np.all(errors[joints] < TURNED_FALLS_TO * self.as_given[joints]):
                return [_degrees(self.motion, i, self._before_and_after(i, errors)) for i in joints]
        return []

    def _before_and_after(self, joint: int, errors: Array) -> str:
        before, after = 100 * self.as_given[joint], 100 * errors[joint]
        return f"the best fit misses {before:.3g} % of its torque, with positions in degrees {after:.3g} %"

    def exchanged(self) -> list[Suspicion]:
        """Two joints each of whose torques belongs to the other's motion, with each other's positions, or in each
        other's place: drivers log joints in the order of their names."""
        doubtful = [i for i in self.able if self.as_given[i] > SUSPECTED_FROM]
        found: list[tuple[float, tuple[str, ...], int, int]] = []
        trials: dict[tuple[str, ...], Callable[[Array], Array]] = {
            ("tau",): self._with_torques,
            ("q",): lambda mix: self._with_positions(mix, np.eye(self.motion.n)),
            ("q", "tau"): lambda mix: self._with_positions(mix, mix),
        }
        for (i, j), (what, tried) in product(combinations(doubtful, 2), trials.items()):
            mix = np.eye(self.motion.n)
            mix[[i, j]] = mix[[j, i]]
            errors = tried(mix)
            falls = max(errors[i] / self.as_given[i], errors[j] / self.as_given[j])
            if falls < EXCHANGED_FALLS_TO and self._whole(errors) < self._whole(self.as_given):
                found.append((self._whole(errors), what, i + 1, j + 1))
        return [_exchanged(self.motion, what, one, other) for _, what, one, other in sorted(found)[:1]]


def _exchanged(motion: Motion, what: tuple[str, ...], one: int, other: int) -> Suspicion:
    columns = " and ".join(f"{name}{one}" for name in what)
    where = f"fits joint {other}, and that of joint {other} fits joint {one}"
    pairs = [(f"{name}{a}", f"{name}{b}") for name in what for a, b in ((one, other), (other, one))]
    maps = " ".join(read_from(motion.cells, column, place) for column, place in pairs)
    alone = f"tau{one} follows the motion of joint {other}, and tau{other} that of joint {one}"
    return Suspicion(
        one,
        "exchanged",
        f"what is recorded as {columns} {where}" if len(what) > 1 else alone,
        f"expected position and torque of a joint under its own number: pass {maps}",
    )


class _LooseTrials(_Trials):
    """Trials of which any inertia is believed."""

    def _possible(self, motion: Motion, lumps: Array) -> bool:  # noqa: ARG002 - any will do
        return True


def _changed(motion: Motion, change: Callable[[Piece], Piece]) -> Motion:
    return replace(motion, pieces=tuple(change(p) for p in motion.pieces))


def _turns(motion: Motion, joint: int) -> float:
    """Over how many turns a joint (0-based) moves."""
    low = min(float(p.q[joint].min()) for p in motion.pieces)
    return (max(float(p.q[joint].max()) for p in motion.pieces) - low) / (2 * pi)


def _by_factor(identification: Identification, able: Sequence[int]) -> list[Suspicion]:
    """Joints whose inertia comes out as the file's divided by the gear ratio or a radian's degrees, or times 1000."""
    if not identification.model.lumps_known:
        return []
    found = []
    for i, (fitted, stated) in enumerate(_inertias(identification)):
        info = identification.model.joints[i]
        if i not in able or not (isfinite(stated) and fitted > 0 and stated > 0):
            continue
        said = f"its inertia comes to {fitted:.3g}, 1/{stated / fitted:.3g} of the {stated:.3g} in the model file"
        if _turns(identification.motion, i) > 1 and info.type == "revolute" and _about(stated / fitted, 1 / DEGREE):
            found.append(_degrees(identification.motion, i, said))
        elif _about(stated / fitted, MILLI):
            unit = "mN m" if info.torque_constant is None else "mA"
            cure = in_unit(identification.motion.cells, f"tau{i + 1}", unit)
            large = f"its inertia comes to {fitted:.3g}, {fitted / stated:.4g} times the {stated:.3g} in the model file"
            found.append(Suspicion(i + 1, "milli", large, f"if its torque is in {unit}, pass {cure}"))
        elif info.gear_ratio > LEAST_TELLING_RATIO and _about(stated / fitted, info.gear_ratio):
            found.append(
                Suspicion(
                    i + 1,
                    "ratio",
                    said,
                    f"expected the motor's torque times the gear ratio of {info.gear_ratio:g}: multiply tau{i + 1}, or "
                    "the joint's torque_constant, by it",
                )
            )
    return found


def _degrees(motion: Motion, joint: int, said: str) -> Suspicion:
    return Suspicion(
        joint + 1,
        "degrees",
        f"its position covers {_turns(motion, joint):.3g} turns, and {said}",
        f"expected radians: if it is in degrees, pass {in_unit(motion.cells, f'q{joint + 1}', 'deg')}",
    )


def _about(ratio: float, factor: float) -> bool:
    return abs(log(ratio / factor)) < log(FACTOR_OF_INERTIA)


def _inertias(identification: Identification) -> list[tuple[float, float]]:
    """D_ii as fitted and as the model file states it, kg m² (kg), of every joint at q = 0."""
    model, rest = identification.model, np.zeros((identification.model.n, 1))
    lumps = identification.fit.coefficients[identification.problem.layout.lumps]
    fitted, stated = (np.diagonal(model.inertia(rest, x)[:, :, 0]) for x in (lumps, model.lump_values))
    return [(float(a), float(b)) for a, b in zip(fitted, stated, strict=True)]

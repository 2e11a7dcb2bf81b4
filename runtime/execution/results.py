"""One cycle of a plan and of its executions: costs, tracking, extremes, contact, and limits that the plan exceeds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from msgspec import UNSET

from runtime.documents.plans import (
    CycleEntry,
    CycleOfPlanEntry,
    ExcessEntry,
    ModelledCostEntry,
    TrialEntry,
)
from runtime.execution.trial import RUN_IN, Trial
from runtime.model.loader import Model
from runtime.model.terms import SURFACE, Structure, given
from runtime.planning.evaluate import Effort, effort, every_instant, limited, mounted
from runtime.planning.trajectory import JointMotion, Trajectory
from runtime.wording import number, told_apart


@dataclass(frozen=True)
class PlannedCycle:
    """One cycle of a trajectory on its arm, with all that the model contains."""

    model: Model
    trajectory: Trajectory

    @cached_property
    def terms(self) -> Structure:
        """The arm's effects with the trajectory's springs and contact."""
        return mounted(self.model, self.trajectory)

    @cached_property
    def planned(self) -> Effort:
        """As planned: without friction if the plan left it out."""
        return effort(self.model, self.trajectory)

    @cached_property
    def modelled(self) -> Effort:
        """With all that the model contains."""
        return self.planned if self.trajectory.friction else effort(self.model, self.trajectory, friction=True)

    @cached_property
    def dense(self) -> Effort:
        """The same in even steps, ends included."""
        return every_instant(self.model, self.trajectory, friction=True)

    @property
    def motion(self) -> JointMotion:
        """Positions, rates and accelerations of one cycle, (n, N) each."""
        return self.dense.motion

    @cached_property
    def tip_y(self) -> float:
        """Smallest y of the end-effector, m."""
        return float(self.dense.tip[1].min())

    def compression(self, tip_y: float) -> float | None:
        """Compression of the plate for this smallest y of the end-effector, m; None without a plate."""
        surface = given(self.model.library, self.terms, SURFACE)
        return None if surface is None else max(0.0, surface - tip_y)

    def exceeded(self) -> Iterator[ExcessEntry]:
        """Limits that the plan exceeds: the largest excess of each kind and joint."""
        for along in (quantity for quantity in limited(self.dense) if not quantity.kept):
            k = int(np.argmax(along.excess))
            t, joint, unit = float(self.motion.t[k]), along.joint + 1, along.unit
            value, limit = float(along.x[k]), along.high if along.x[k] > along.high else along.low
            if along.what != "position":
                value, limit = abs(value), abs(limit)
            text = (
                f"the plan's {along.what} of joint {joint} is {told_apart(value, limit, 4)} {unit} at "
                f"t = {t:.4g} s, {abs(value - limit):.3g} {unit} beyond the limit of {number(limit, 4)}"
            )
            yield ExcessEntry(what=along.what, joint=joint, t=t, value=value, limit=limit, unit=unit, text=text)

    def document(self) -> CycleOfPlanEntry:
        """The plan's own figures: `cost` as planned, `modelled` with all that the model contains."""
        cost, modelled = self.planned.cost, self.modelled.cost
        return CycleOfPlanEntry(
            scenario=self.trajectory.scenario,
            duration=self.trajectory.duration,
            periodic=self.trajectory.periodic,
            friction=self.trajectory.friction,
            cost=cost.tolist(),
            total=float(cost.sum()),
            modelled=ModelledCostEntry(cost=modelled.tolist(), total=float(modelled.sum())),
            peak_torque=np.abs(self.planned.tau).max(axis=1).tolist(),
            q_min=self.motion.q.min(axis=1).tolist(),
            q_max=self.motion.q.max(axis=1).tolist(),
            tip_y=self.tip_y,
            compression=self.compression(self.tip_y),
        )


# --- executed cycles ---


def _cycle(trial: Trial, plan: PlannedCycle, dt: float, number: int) -> CycleEntry:
    begin, end = number * plan.trajectory.duration, (number + 1) * plan.trajectory.duration
    part = slice(round(begin / dt), round(end / dt))
    q, tau = trial.q[:, part], trial.tau[:, part]
    error = q - trial.q_desired[:, part]
    # Torques are held over each period, so that the integral is exact also for a part of a period.
    edges = np.arange(trial.tau.shape[1] + 1) * dt
    sums = [np.append(0.0, np.cumsum(row**2) * dt) for row in trial.tau]
    cost = np.array([np.diff(np.interp([begin, end], edges, row))[0] for row in sums])
    tip_y = float(plan.model.tip(q)[1].min())
    return CycleEntry(
        cost=cost.tolist(),
        tracking_rms=np.sqrt(np.mean(error**2, axis=1)).tolist(),
        tracking_max=np.abs(error).max(axis=1).tolist(),
        q_min=q.min(axis=1).tolist(),
        q_max=q.max(axis=1).tolist(),
        peak_torque=np.abs(tau).max(axis=1).tolist(),
        tip_y=tip_y,
        saturated=float(trial.saturated[part].mean()),
        total=float(cost.sum()),
        compression=plan.compression(tip_y),
    )


def trial_entry(number: int, trial: Trial, plan: PlannedCycle, dt: float) -> TrialEntry:
    """A trial (number: from 1) with its complete cycles after the run-in; dt: s between its records."""
    trajectory = plan.trajectory
    first = RUN_IN if trajectory.periodic else 0
    done = int(len(trial.t) * dt / trajectory.duration + 1e-9)
    last = done if trajectory.periodic else min(done, 1)
    cycles = [_cycle(trial, plan, dt, k) for k in range(first, last)]
    watched = UNSET if trial.watched is None else list(trial.watched)
    return TrialEntry(trial=number, seconds=len(trial.t) * dt, stop=trial.stop, cycles=cycles, watched=watched)


def mean(found: Sequence[CycleEntry]) -> CycleEntry | None:
    """Of every figure over the cycles; None without any."""
    return _over(found, lambda x: np.mean(x, axis=0)) if found else None


def spread(found: Sequence[CycleEntry]) -> CycleEntry | None:
    """Standard deviation of every figure over the cycles; None for fewer than two."""
    return _over(found, lambda x: np.std(x, axis=0, ddof=1)) if len(found) > 1 else None


def _over(found: Sequence[CycleEntry], statistic: Any) -> CycleEntry:
    columns = {name: [getattr(cycle, name) for cycle in found] for name in CycleEntry.__struct_fields__}
    figures: dict[str, Any] = {
        name: None if column[0] is None else statistic(column).tolist() for name, column in columns.items()
    }
    return CycleEntry(**figures)

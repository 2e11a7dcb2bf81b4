"""What an execution came to, beside its plan: costs, tracking, extremes, contact, for each cycle of each trial."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.execution.demand import PlannedCycle, compression
from runtime.execution.trial import RUN_IN, Trial

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Cycle:
    """One cycle. (n,) each but for tip_y (m) and saturated (part of the time).

    cost   integral of the squared torque command over the cycle
    """

    cost: Array
    tracking_rms: Array
    tracking_max: Array
    q_min: Array
    q_max: Array
    peak_torque: Array
    tip_y: float
    saturated: float


def cycles(trial: Trial, plan: PlannedCycle, dt: float) -> list[Cycle]:
    """The cycles that a trial went through, without its run-in."""
    duration, first = plan.trajectory.duration, RUN_IN if plan.trajectory.periodic else 0
    done = int(len(trial.t) * dt / duration + 1e-9)
    return [_cycle(trial, plan, k * duration, (k + 1) * duration, dt) for k in range(first, done)][: _most(plan)]


def _most(plan: PlannedCycle) -> int | None:
    return None if plan.trajectory.periodic else 1


def _cycle(trial: Trial, plan: PlannedCycle, begin: float, end: float, dt: float) -> Cycle:
    part = slice(round(begin / dt), round(end / dt))
    q, tau = trial.q[:, part], trial.tau[:, part]
    error = q - trial.q_desired[:, part]
    return Cycle(
        cost=_held(trial.tau, dt, begin, end),
        tracking_rms=np.sqrt(np.mean(error**2, axis=1)),
        tracking_max=np.abs(error).max(axis=1),
        q_min=q.min(axis=1),
        q_max=q.max(axis=1),
        peak_torque=np.abs(tau).max(axis=1),
        tip_y=float(plan.model.tip(q)[1].min()),
        saturated=float(trial.saturated[part].mean()),
    )


def _held(tau: Array, dt: float, begin: float, end: float) -> Array:
    """(n,) integral of tau^2 from begin to end, tau held over each period: exact, also for a part of a period."""
    edges = np.arange(tau.shape[1] + 1) * dt
    return np.array([np.diff(np.interp([begin, end], edges, np.append(0.0, np.cumsum(row**2) * dt)))[0] for row in tau])


def document(plan: PlannedCycle, trials: Sequence[Trial], dt: float) -> dict[str, Any]:
    """Every figure, in SI; `mean` and `spread` over all cycles of all trials, None if there is none."""
    found = [cycles(trial, plan, dt) for trial in trials]
    every = [cycle for part in found for cycle in part]
    stopped = [trial for trial in trials if trial.stop is not None]
    return {
        "status": "stopped" if stopped else "done",
        "reason": _reason(trials),
        "joints": [
            {"joint": i, "name": j.name, "position_unit": j.position_unit, "force_unit": j.force_unit}
            for i, j in enumerate(plan.model.joints, 1)
        ],
        "plan": plan_document(plan),
        "trials": [
            {"trial": k, "seconds": len(trial.t) * dt, "stop": _stop(trial), "cycles": [_plain(c, plan) for c in part]}
            for k, (trial, part) in enumerate(zip(trials, found, strict=True), 1)
        ],
        "mean": _over(every, plan, lambda x: np.mean(x, axis=0)),
        "spread": _over(every, plan, lambda x: np.std(x, axis=0, ddof=1)) if len(every) > 1 else None,
    }


def plan_document(plan: PlannedCycle) -> dict[str, Any]:
    """The plan's own figures. `cost` as it was planned, `modelled` with all that the model knows."""
    cost, modelled = plan.planned.cost, plan.modelled.cost
    return {
        "scenario": plan.trajectory.scenario,
        "duration": plan.trajectory.duration,
        "periodic": plan.trajectory.periodic,
        "friction": plan.trajectory.friction,
        "cost": cost,
        "total": cost.sum(),
        "modelled": {"cost": modelled, "total": modelled.sum()},
        "peak_torque": np.abs(plan.planned.tau).max(axis=1),
        "q_min": plan.motion.q.min(axis=1),
        "q_max": plan.motion.q.max(axis=1),
        "tip_y": plan.tip_y,
        "compression": compression(plan, plan.tip_y),
    }


def _plain(cycle: Cycle, plan: PlannedCycle) -> dict[str, Any]:
    return {**vars(cycle), "total": cycle.cost.sum(), "compression": compression(plan, cycle.tip_y)}


def _over(every: Sequence[Cycle], plan: PlannedCycle, statistic: Any) -> dict[str, Any] | None:
    """A statistic of every figure over the cycles."""
    if not every:
        return None
    pages = [_plain(cycle, plan) for cycle in every]
    return {name: None if pages[0][name] is None else statistic([page[name] for page in pages]) for name in pages[0]}


def _stop(trial: Trial) -> dict[str, Any] | None:
    return None if trial.stop is None else vars(trial.stop)


def _reason(trials: Sequence[Trial]) -> str | None:
    for k, trial in enumerate(trials, 1):
        if trial.stop is not None:
            at = "" if trial.stop.joint is None else f"joint {trial.stop.joint}: "
            return f"trial {k} at t = {trial.stop.t:.4g} s: {at}{trial.stop.reason}"
    return None

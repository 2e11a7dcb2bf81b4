"""A plan, or the reason why there is none, with every figure: what --json gives and what the terminal shows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from runtime.model.loader import Model
from runtime.model.terms import Values
from runtime.planning.evaluate import Effort, at_times, effort
from runtime.planning.optimize import Infeasible, Plan, SpringChoice
from runtime.planning.program import MET, Attempt
from runtime.planning.scenario import Scenario, SoughtSpring, usual
from runtime.planning.trajectory import Trajectory
from symbolic.described import DescribedParameter
from symbolic.model_file.fields import JointType

SAMPLES = 400
"""Of one cycle, in the document."""
UNIT = {"peak_torque": "1", "electrical_energy": "J", "positive_work": "J"}


def document(model: Model, plan: Plan) -> dict[str, Any]:
    """A plan. SI units; costs in (N m)² s."""
    return {
        "scenario": plan.scenario.name,
        "arm": model.name,
        "feasible": True,
        "cycle_time": plan.scenario.cycle_time,
        "friction": plan.scenario.friction,
        "objective": {**_goal(model, plan.scenario), "value": plan.cost, "smooth": plan.smooth_cost},
        "joints": [_joint(model, plan.effort, plan.scenario.ranges, i) for i in range(model.n)],
        "phases": [
            {"from": p.start, "to": p.end, "kind": p.kind, "duration": plan.scenario.cycle_time * p.part}
            for p in plan.scenario.phases
        ],
        "springs": [
            _spring(model, spring, plan.trajectory.springs[spring.plan.joint], plan.free[spring.plan.joint])
            for spring in sorted(plan.springs, key=lambda s: s.plan.joint)
        ],
        "catalogue": [{**_sizes(plan, choice), "cost": choice.cost} for choice in plan.choices],
        "trajectory": plan.trajectory.to_json(),
        "samples": _samples(model, plan.trajectory),
        "solver": {
            "attempts": [_attempt(a) for a in plan.attempts],
            "refined": _attempt(plan.refined),
            "setup_seconds": plan.setup_seconds,
            "seconds": plan.seconds,
        },
        "left_out": dict(plan.left_out),
        "warnings": [*warnings(model, plan.scenario), *_idle(plan), *_under_way(model, plan)],
    }


def stated(model: Model, trajectory: Trajectory) -> dict[str, Any]:
    """A trajectory that was read from its file: what can be said without its scenario, as `document` says it.

    There is no goal; a phase has a kind and no points, and a joint the limits of the model file.
    """
    found = effort(model, trajectory)
    return {
        "scenario": trajectory.scenario,
        "arm": model.name,
        "cycle_time": trajectory.duration,
        "friction": trajectory.friction,
        "joints": [_joint(model, found, {}, i) for i in range(model.n)],
        "phases": [
            {"kind": "free" if phase.coordinates == "q" else "contact", "duration": phase.duration}
            for phase in trajectory.phases
        ],
        "springs": [
            {"joint": joint, **values, "text": _in_words(model, trajectory, joint)}
            for joint, values in sorted(trajectory.springs.items())
        ],
        "samples": _samples(model, trajectory),
    }


def _in_words(model: Model, trajectory: Trajectory, joint: int) -> str:
    """What a plan may choose of a spring, at the joint (1-based) of a trajectory."""
    info = model.library[trajectory.spring(model.library, joint).effect]
    planned = [p for p in info.parameters if p.planned]
    return _words(planned, trajectory.springs[joint], model.joints[joint - 1].type)


def _joint(model: Model, effort: Effort, ranges: Mapping[int, tuple[float, float]], i: int) -> dict[str, Any]:
    """What a plan asks of a joint (0-based), and its limits: those of the model file, and a scenario's narrower range
    of positions."""
    info = model.joints[i]
    return {
        "joint": i + 1,
        "name": info.name,
        "cost": float(effort.cost[i]),
        "peak_torque": float(np.abs(effort.tau[i]).max()),
        "peak_speed": float(np.abs(effort.motion.qd[i]).max()),
        "range": [float(effort.motion.q[i].min()), float(effort.motion.q[i].max())],
        "limits": {
            "position": _listed_span(ranges.get(i + 1, info.position_limits)),
            "speed": info.speed_limit,
            "torque": info.torque_limit,
        },
        "units": {"position": info.position_unit, "force": info.force_unit},
    }


def _listed_span(span: tuple[float, float] | None) -> list[float] | None:
    return None if span is None else list(span)


def _spring(model: Model, spring: SoughtSpring, values: Values, free: float) -> dict[str, Any]:
    """Values and size sought, and the same in words."""
    kind = model.joints[spring.plan.joint - 1].type
    foreign = {} if spring.info.name == usual(model.library.effects) else {"effect": spring.info.name}
    unit, text = spring.size.unit.text(kind), _words(spring.sought, values, kind)
    return {"joint": spring.plan.joint, **foreign, **values, "sought": free, "unit": unit, "text": text}


def _words(parameters: Sequence[DescribedParameter], values: Values, kind: JointType) -> str:
    """Parameters of a spring with their values."""
    return ", ".join(
        f"{p.name if p.says is None else p.says} {float(f'{values[p.name]:.4g}'):g} {p.unit.text(kind)}".strip()
        for p in parameters
    )


def _sizes(plan: Plan, choice: SpringChoice) -> dict[str, dict[str, float]]:
    """By the name of what is bought, by joint."""
    names = {s.plan.joint: s.size.name for s in plan.springs}
    found: dict[str, dict[str, float]] = {}
    for joint, value in choice.sizes.items():
        found.setdefault(names[joint], {})[str(joint)] = value
    return found


def refusal(model: Model, scenario: Scenario, error: Infeasible) -> dict[str, Any]:
    """Why there is no plan: the constraint that the best attempt misses most."""
    missed = error.missed
    return {
        "scenario": scenario.name,
        "arm": model.name,
        "feasible": False,
        "reason": str(error),
        "missed": {"where": missed.where, "what": missed.what, "amount": missed.amount, "unit": missed.unit},
        "solver": {"attempts": [_attempt(a) for a in error.attempts]},
    }


def warnings(model: Model, scenario: Scenario) -> list[str]:
    """What a person should know before they believe the plan."""
    unlimited = [j for j in scenario.moving if model.joints[j - 1].speed_limit is None]
    found = []
    if scenario.friction and unlimited:
        found.append(
            f"no speed limit for joint {_listed(unlimited)}: a friction map holds up to the speeds that it was "
            "identified at, and beyond them a plan may find friction that is not there; add [joint.limits] speed"
        )
    return found


def _idle(plan: Plan) -> list[str]:
    """That a spring is there for nothing."""
    idle = [joint for joint in sorted(plan.trajectory.springs) if not plan.effort.spring[joint - 1].any()]
    return [f"the spring at joint {j} pulls nowhere in this motion, which gains nothing from it" for j in idle]


def _under_way(model: Model, plan: Plan) -> list[str]:
    """That joints move at an end of a motion which is made once: nothing that stands follows it there."""
    trajectory, phases = plan.trajectory, plan.scenario.phases
    if trajectory.periodic:
        return []
    moving = np.abs(trajectory.at(model, [0.0, trajectory.duration]).qd) > MET
    ends = ("begins", "stands before", phases[0].start), ("ends", "stands afterwards", phases[-1].end)
    return [
        f"the motion {what} with joints that move ({_listed((np.flatnonzero(moving[:, k]) + 1).tolist())}); if the arm "
        f"{stands}, say rest = true in [points.{point}]"
        for k, (what, stands, point) in enumerate(ends)
        if moving[:, k].any()
    ]


def _listed(numbers: Sequence[int]) -> str:
    return ", ".join(map(str, numbers))


def _goal(model: Model, scenario: Scenario) -> dict[str, Any]:
    joints = list(scenario.objective.joints or scenario.moving)
    kinds = {model.joints[j - 1].force_unit for j in joints}
    squared = f"({'/'.join(sorted(kinds))})^2 s"
    goal = scenario.objective.goal
    return {"goal": goal, "joints": joints, "unit": UNIT.get(goal, squared)}


def _samples(model: Model, trajectory: Trajectory) -> dict[str, Any]:
    t = np.linspace(0.0, trajectory.duration, SAMPLES, endpoint=False)
    seen = at_times(model, trajectory, t)
    motion = seen.motion
    series = {"q": motion.q, "qd": motion.qd, "qdd": motion.qdd, "tau": seen.tau, "spring": seen.spring}
    tip = {"tip": seen.tip}
    if model.spatial:
        tip["tip_rotation"] = model.call("tip_rotation", {"q": motion.q})
    return {"t": t.tolist(), **{k: v.tolist() for k, v in {**series, **tip}.items()}}


def _attempt(a: Attempt) -> dict[str, Any]:
    return {
        "cost": a.cost,
        "met": a.met,
        "status": a.status,
        "iterations": a.iterations,
        "seconds": a.seconds,
        "missed": None if a.missed is None else str(a.missed),
    }

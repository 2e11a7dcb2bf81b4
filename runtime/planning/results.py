"""A plan, a trajectory from a file, or the reason why there is no plan, as the document that --json prints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from msgspec import UNSET, UnsetType

from runtime.documents.parts import IterationsEntry
from runtime.documents.plans import (
    AttemptEntry,
    FailedSearchEntry,
    InfeasibleDocument,
    JointUnitsEntry,
    MotionDocument,
    ObjectiveEntry,
    OptimizeDocument,
    PhaseEntry,
    PlanLimitsEntry,
    PlannedJointEntry,
    SamplesEntry,
    SolverEntry,
    SpringValues,
    ViolationEntry,
)
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
"""Samples of one cycle in the document."""
UNIT = {"peak_torque": "1", "electrical_energy": "J", "positive_work": "J"}


def document(model: Model, plan: Plan, bare: Plan | Infeasible | UnsetType = UNSET) -> OptimizeDocument:
    """A plan; bare: as `optimize.without_springs` has it, UNSET where it was not asked."""
    s, came = plan.scenario, [plan.search]
    without_springs: float | UnsetType | None = UNSET
    if not isinstance(bare, UnsetType):
        without_springs = bare.cost if isinstance(bare, Plan) else None
        came.append(bare.search)
    kinds = {model.joints[j - 1].force_unit for j in s.counted}
    squared = f"({'/'.join(sorted(kinds))})^2 s"
    return OptimizeDocument(
        scenario=s.name,
        arm=model.name,
        cycle_time=s.cycle_time,
        friction=s.friction,
        objective=ObjectiveEntry(
            goal=s.objective.goal,
            joints=list(s.counted),
            unit=UNIT.get(s.objective.goal, squared),
            value=plan.cost,
            smooth=plan.smooth_cost,
            without_springs=without_springs,
        ),
        joints=[_joint(model, plan.effort, s.ranges, i) for i in range(model.n)],
        phases=[PhaseEntry(start=p.start, end=p.end, kind=p.kind, duration=s.cycle_time * p.part) for p in s.phases],
        springs=[
            _spring(model, spring, plan.trajectory.springs[spring.plan.joint], plan.free[spring.plan.joint])
            for spring in sorted(plan.springs, key=lambda s: s.plan.joint)
        ],
        catalogue=[{**_sizes(plan, choice), "cost": choice.cost} for choice in plan.choices],
        trajectory=plan.trajectory.document(),
        samples=_samples(model, plan.trajectory),
        solver=SolverEntry(
            attempts=[_attempt(a) for a in plan.attempts],
            refined=_attempt(plan.refined),
            setup_seconds=plan.setup_seconds,
            seconds=plan.seconds,
        ),
        search=IterationsEntry.of(
            sum(one.iterations for one in came),
            sum(one.iterations for one in came[:-1]) + came[-1].budget,
            [one.ended for one in came],
        ),
        left_out=dict(plan.left_out),
        warnings=_warnings(model, plan),
    )


def stated(model: Model, trajectory: Trajectory) -> MotionDocument:
    """A trajectory from a file: no objective, phases without points, limits of the model file only."""
    found = effort(model, trajectory)
    springs: list[SpringValues] = []
    for joint, values in sorted(trajectory.springs.items()):
        info = model.library[trajectory.spring(model.library, joint).effect]
        planned = [p for p in info.parameters if p.planned]
        springs.append({"joint": joint, **values, "text": _words(planned, values, model.joints[joint - 1].type)})
    return MotionDocument(
        scenario=trajectory.scenario,
        arm=model.name,
        cycle_time=trajectory.duration,
        friction=trajectory.friction,
        joints=[_joint(model, found, {}, i) for i in range(model.n)],
        phases=[
            PhaseEntry(kind="free" if phase.coordinates == "q" else "contact", duration=phase.duration)
            for phase in trajectory.phases
        ],
        springs=springs,
        samples=_samples(model, trajectory),
    )


def refusal(model: Model, scenario: Scenario, error: Infeasible) -> InfeasibleDocument:
    """Why there is no plan: the constraint that the best attempt violates most."""
    missed = error.missed
    return InfeasibleDocument(
        scenario=scenario.name,
        arm=model.name,
        reason=str(error),
        missed=ViolationEntry(where=missed.where, what=missed.what, amount=missed.amount, unit=missed.unit),
        solver=FailedSearchEntry(attempts=[_attempt(a) for a in error.attempts]),
        search=error.search,
    )


def _joint(model: Model, effort: Effort, ranges: Mapping[int, tuple[float, float]], i: int) -> PlannedJointEntry:
    """A joint (0-based) in a plan; ranges: of the scenario, by joint (1-based)."""
    info, q = model.joints[i], effort.motion.q[i]
    return PlannedJointEntry(
        joint=i + 1,
        name=info.name,
        cost=float(effort.cost[i]),
        peak_torque=float(np.abs(effort.tau[i]).max()),
        peak_speed=float(np.abs(effort.motion.qd[i]).max()),
        range=(float(q.min()), float(q.max())),
        limits=PlanLimitsEntry(
            position=ranges.get(i + 1, info.position_limits), speed=info.speed_limit, torque=info.torque_limit
        ),
        units=JointUnitsEntry(position=info.position_unit, force=info.force_unit),
    )


def _spring(model: Model, spring: SoughtSpring, values: Values, free: float) -> SpringValues:
    kind = model.joints[spring.plan.joint - 1].type
    foreign = {} if spring.info.name == usual(model.library.effects) else {"effect": spring.info.name}
    unit, text = spring.size.unit.text(kind), _words(spring.sought, values, kind)
    return {"joint": spring.plan.joint, **foreign, **values, "sought": free, "unit": unit, "text": text}


def _words(parameters: Sequence[DescribedParameter], values: Values, kind: JointType) -> str:
    return ", ".join(
        f"{p.name if p.says is None else p.says} {float(f'{values[p.name]:.4g}'):g} {p.unit.text(kind)}".strip()
        for p in parameters
    )


def _sizes(plan: Plan, choice: SpringChoice) -> dict[str, dict[str, float]]:
    """Sizes by the name of the parameter and by joint."""
    names = {s.plan.joint: s.size.name for s in plan.springs}
    found: dict[str, dict[str, float]] = {}
    for joint, value in choice.sizes.items():
        found.setdefault(names[joint], {})[str(joint)] = value
    return found


def _warnings(model: Model, plan: Plan) -> list[str]:
    """What to know before the plan is used."""
    scenario, trajectory = plan.scenario, plan.trajectory
    found = []
    unlimited = [j for j in scenario.moving if model.joints[j - 1].speed_limit is None]
    if scenario.friction and unlimited:
        found.append(
            f"no speed limit for joint {_listed(unlimited)}: a friction map is valid up to the speeds of its "
            "identification, and beyond them a plan may rely on friction that does not exist; add [joint.limits] speed"
        )
    idle = [joint for joint in sorted(trajectory.springs) if not plan.effort.spring[joint - 1].any()]
    found += [f"the spring at joint {j} is slack during the whole motion and saves nothing" for j in idle]
    if trajectory.periodic:
        return found
    moving = np.abs(trajectory.at(model, [0.0, trajectory.duration]).qd) > MET
    points = scenario.phases[0].start, scenario.phases[-1].end
    ends = ("begins", "stands before", points[0]), ("ends", "stands afterwards", points[1])
    found += [
        f"the motion {what} with joints that move ({_listed((np.flatnonzero(moving[:, k]) + 1).tolist())}); if the arm "
        f"{stands}, say rest = true in [points.{point}]"
        for k, (what, stands, point) in enumerate(ends)
        if moving[:, k].any()
    ]
    return found


def _listed(numbers: Sequence[int]) -> str:
    return ", ".join(map(str, numbers))


def _samples(model: Model, trajectory: Trajectory) -> SamplesEntry:
    t = np.linspace(0.0, trajectory.duration, SAMPLES, endpoint=False)
    seen = at_times(model, trajectory, t)
    m = seen.motion
    series = {"q": m.q, "qd": m.qd, "qdd": m.qdd, "tau": seen.tau, "spring": seen.spring, "tip": seen.tip}
    if model.spatial:
        series["tip_rotation"] = model.call("tip_rotation", {"q": m.q})
    return SamplesEntry(t=t.tolist(), **{name: values.tolist() for name, values in series.items()})


def _attempt(a: Attempt) -> AttemptEntry:
    return AttemptEntry(
        cost=a.cost,
        met=a.met,
        status=a.status,
        iterations=a.iterations,
        seconds=a.seconds,
        missed=None if a.missed is None else str(a.missed),
    )

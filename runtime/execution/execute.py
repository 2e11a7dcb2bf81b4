"""A trajectory executed on the simulated arm, several times: what was planned, what happened, and the recording."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from runtime.execution import results
from runtime.execution.demand import Excess, PlannedCycle
from runtime.execution.options import TRIALS, ExecutionSettings
from runtime.execution.simulated import SimulatedArm
from runtime.execution.trial import RUN_IN, Trial, length, recorded, run
from runtime.hardware.boards import HostBoard
from runtime.hardware.link import Codec
from runtime.hardware.lockstep import Board, Lockstep
from runtime.hardware.session import Session
from runtime.hardware.settings import ControllerError, Settings
from runtime.model.loader import Model
from runtime.model.terms import Structure, Term
from runtime.planning.trajectory import Trajectory
from runtime.progress import steps
from runtime.recordings.recording import Recording
from runtime.recordings.settings import MOST_SAMPLES
from runtime.simulation.plant import Plant
from runtime.simulation.settings import RATE
from runtime.simulation.simulate import Hidden, complete, true_effects


@dataclass(frozen=True)
class Execution:
    """Trials of a plan, none where it asks for more than the limits allow.

    compensated     whether the controller compensated friction
    dt              s from one record to the next, as the model file has the rate
    uncompensated   effects of the model that it does not compensate
    arm             the effects of the arm that it ran on, with all values
    hidden          those that the model has not
    """

    plan: PlannedCycle
    dt: float
    compensated: bool
    uncompensated: tuple[str, ...]
    arm: Structure
    hidden: frozenset[Term]
    seed: int
    noise: float
    excess: tuple[Excess, ...]
    trials: tuple[Trial, ...]

    @cached_property
    def recording(self) -> Recording | None:
        """All trials, a run each; None if nothing has moved."""
        moved = any(len(trial.t) for trial in self.trials)
        return recorded(self.trials, self.plan.model, self.noise, self.seed) if moved else None

    @property
    def completed(self) -> bool:
        """Whether every trial came to its end."""
        return bool(self.trials) and all(trial.stop is None for trial in self.trials)

    @property
    def _period(self) -> float | None:
        """s from one record to the next by the board's clock; None where there are none."""
        ends = [(trial.t[-1] - trial.t[0], len(trial.t) - 1) for trial in self.trials if len(trial.t) > 1]
        return sum(seconds for seconds, _ in ends) / sum(count for _, count in ends) if ends else None

    def to_json(self) -> dict[str, Any]:
        """Every figure, in SI."""
        effects = [
            {
                "effect": term.effect,
                "joint": term.joint,
                "hidden": term in self.hidden,
                "changed": term in self.plan.terms and dict(values) != dict(self.plan.terms[term]),
                "values": dict(values),
            }
            for term, values in self.arm.items()
        ]
        return {
            "arm": self.plan.model.name,
            "period": self.dt,
            "period_measured": self._period,
            "friction_compensation": self.compensated,
            "uncompensated": list(self.uncompensated),
            "run_in": RUN_IN if self.plan.trajectory.periodic else 0,
            "seed": self.seed,
            "noise": self.noise,
            "effects": effects,
            "exceeded": [{**vars(item), "text": str(item)} for item in self.excess],
            **results.document(self.plan, self.trials, self.dt),
            **({"status": "refused", "reason": str(self.excess[0])} if self.excess else {}),
        }


def nobody() -> AbstractContextManager[Callable[[], int]]:
    """Who might want to stop an arm that moves."""
    return nullcontext(lambda: 0)


def execute(
    model: Model,
    controller: Path,
    trajectory: Trajectory,
    settings: ExecutionSettings = ExecutionSettings(),
    hidden: Sequence[Hidden] = (),
    changed: Sequence[Hidden] = (),
    board: Callable[[Path, str, int], Board] = HostBoard,
    listening: Callable[[], AbstractContextManager[Callable[[], int]]] = nobody,
) -> Execution:
    """The trajectory on a simulated arm, from rest, until all trials are done or one is stopped.

    controller       directory of the arm's compiled controller, for this kind of board
    hidden, changed  effects of the arm that the model has not, or with other values
    board            what drives the arm: made from directory, name and number of joints
    listening        while the arm moves: whether the user wants to stop; see Session.run
    Raises ControllerError, ModelError, PlantError, SimulationError, LinkError, LinkLost.
    """
    compensated = settings.compensates(trajectory)
    told = Settings.of(controller, model, trajectory, compensated, settings.tracking_limit)
    plan = PlannedCycle(model, trajectory)
    seconds = length(trajectory, settings.cycles)
    trials = TRIALS if settings.trials is None else settings.trials
    if (periods := trials * round(seconds / told.dt)) > MOST_SAMPLES:
        raise ControllerError(
            f"{trials} trials of {seconds:.6g} s are {periods} control periods; expected at most {MOST_SAMPLES}, as "
            "many as a recording may have; lower --cycles or --trials"
        )
    values = true_effects(model, plan.terms, changed, hidden)
    if hidden or changed:
        # What is moderate for a cycle is so for all of them.
        t = np.arange(round(length(trajectory, 1) * RATE)) / RATE
        values = complete(model, trajectory.at(model, t).q, values)
    excess = tuple(plan.exceeded())
    arm = SimulatedArm(Plant(model, values, told.dt), told)
    done: list[Trial] = []
    if not excess:
        line = Lockstep(board(controller, model.name, model.n), arm, told.dt)
        session = Session(line, Codec.from_json(controller / "protocol.json"))
        try:
            line.start(plan.motion.q[:, 0], np.random.default_rng([settings.seed, 0]))
            session.identify()
            session.upload(told)
            with listening() as asked, steps("trials", trials) as step:
                while len(done) < trials and not (done and done[-1].stop):
                    line.start(plan.motion.q[:, 0], np.random.default_rng([settings.seed, len(done)]))
                    done.append(run(session, told, seconds, asked=asked))
                    step()
        finally:
            session.close()
    return Execution(
        plan=plan,
        dt=told.dt,
        compensated=compensated,
        uncompensated=told.uncompensated,
        arm=values,
        hidden=frozenset(item.term for item in hidden),
        seed=settings.seed,
        noise=settings.noise,
        excess=excess,
        trials=tuple(done),
    )

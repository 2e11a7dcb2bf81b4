"""A trajectory executed on the simulated arm, several times: the plan, the trials, and the recording."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Literal

import numpy as np

from runtime.arrays import Array
from runtime.documents.plans import ArmEffectEntry, ExcessEntry, ExecutedJointEntry, ExecuteDocument
from runtime.execution.options import TRIALS, ExecutionSettings
from runtime.execution.results import PlannedCycle, mean, spread, trial_entry
from runtime.execution.trial import RUN_IN, Trial, length, recorded, run
from runtime.hardware.boards import HostBoard, QemuBoard, UnicornBoard
from runtime.hardware.link import Codec
from runtime.hardware.lockstep import Board, Counts, Fault, Float32, Lockstep
from runtime.hardware.session import Session
from runtime.hardware.settings import ControllerError, Settings
from runtime.model.loader import Model
from runtime.model.terms import Structure, Term
from runtime.planning.trajectory import Trajectory
from runtime.progress import steps
from runtime.recordings.board_sums import BoardSums
from runtime.recordings.recording import Recording
from runtime.recordings.settings import MOST_SAMPLES
from runtime.simulation.plant import Plant
from runtime.simulation.settings import RATE
from runtime.simulation.simulate import Hidden, complete, true_effects

_MOST = 2.0**31
"""Largest count of an encoder's register."""


@dataclass(frozen=True)
class Simulated:
    """A board in step with the simulated arm. build: target of the firmware that it runs."""

    build: str
    board: Callable[[Path, str, int], Board]


SIMULATED: Mapping[str, Simulated] = {
    "simulation": Simulated("host", HostBoard),
    "unicorn": Simulated("cortex-m4f", UnicornBoard),
    "qemu": Simulated("cortex-m4f", partial(QemuBoard, machine="mps2-an386")),
}
"""By the word of --on."""


class SimulatedArm:
    """A plant with encoders on its motors, as a board sees it: counts, and torques that are held for a period.

    The arm is held where a trial starts until the drives are powered for the first time.
    """

    def __init__(self, plant: Plant, settings: Settings) -> None:
        self.plant = plant
        self._per_count: Array = np.array(settings.drive["position_per_count"])
        self._zero = settings.zero
        self._offset: Array = np.zeros(plant.model.n)
        self._held = True

    def start(self, q: Array, rng: np.random.Generator) -> Counts:
        """At rest at q (n,), with a random position of the encoders' steps. Returns their counts."""
        self.plant.reset(q)
        # An arm cannot be placed more finely than its encoders resolve.
        self._offset = rng.uniform(0.0, 1.0, len(q)) * self._per_count
        self._held = True
        return self.counts()

    def counts(self) -> Counts:
        """(n,) counts of the encoders. Raises Fault if they overflow."""
        steps = np.floor((self.plant.q + self._offset) / self._per_count)
        if not (np.abs(steps) < _MOST).all():
            raise Fault(f"the simulated motion has left all bounds; an effect is too stiff for {self.plant.step:.2g} s")
        return steps.astype(np.int32) + self._zero

    def apply(self, torque: Float32) -> None:
        """Hold these torques for one control period."""
        if not self._held:
            self.plant.advance(torque)

    def enable(self, on: bool) -> None:
        self._held = self._held and not on


@dataclass(frozen=True)
class Execution:
    """Trials of a plan; none if it exceeds limits.

    compensated     whether the controller compensated friction
    dt              s from one record to the next, by the model file's rate
    uncompensated   effects of the model that it does not compensate
    arm             effects of the arm that moved, with all values
    hidden          those that the model does not have
    sums            what the board has added up for identification; None where it adds nothing up
    """

    plan: PlannedCycle
    dt: float
    compensated: bool
    uncompensated: tuple[str, ...]
    arm: Structure
    hidden: frozenset[Term]
    seed: int
    noise: float
    excess: tuple[ExcessEntry, ...]
    trials: tuple[Trial, ...]
    sums: BoardSums | None = None

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
    def status(self) -> Literal["done", "stopped", "refused"]:
        """Refused: the plan exceeds limits."""
        if self.excess:
            return "refused"
        return "stopped" if any(trial.stop for trial in self.trials) else "done"

    @property
    def reason(self) -> str | None:
        """Why it was stopped or refused; None if it was not."""
        if self.excess:
            return self.excess[0].text
        for k, trial in enumerate(self.trials, 1):
            if trial.stop is not None:
                at = "" if trial.stop.joint is None else f"joint {trial.stop.joint}: "
                return f"trial {k} at t = {trial.stop.t:.4g} s: {at}{trial.stop.reason}"
        return None

    @property
    def _period(self) -> float | None:
        """s from one record to the next by the board's clock; None without records."""
        ends = [(trial.t[-1] - trial.t[0], len(trial.t) - 1) for trial in self.trials if len(trial.t) > 1]
        return float(sum(seconds for seconds, _ in ends) / sum(count for _, count in ends)) if ends else None

    def document(self) -> ExecuteDocument:
        """Every figure, without what the command line adds of its target and files."""
        trials = [trial_entry(k, trial, self.plan, self.dt) for k, trial in enumerate(self.trials, 1)]
        every = [cycle for trial in trials for cycle in trial.cycles]
        return ExecuteDocument(
            arm=self.plan.model.name,
            period=self.dt,
            period_measured=self._period,
            friction_compensation=self.compensated,
            uncompensated=list(self.uncompensated),
            run_in=RUN_IN if self.plan.trajectory.periodic else 0,
            seed=self.seed,
            noise=self.noise,
            effects=[
                ArmEffectEntry(
                    effect=term.effect,
                    joint=term.joint,
                    hidden=term in self.hidden,
                    changed=term in self.plan.terms and dict(values) != dict(self.plan.terms[term]),
                    values=dict(values),
                )
                for term, values in self.arm.items()
            ],
            exceeded=list(self.excess),
            status=self.status,
            reason=self.reason,
            joints=[
                ExecutedJointEntry(joint=i, name=j.name, position_unit=j.position_unit, force_unit=j.force_unit)
                for i, j in enumerate(self.plan.model.joints, 1)
            ],
            plan=self.plan.document(),
            trials=trials,
            mean=mean(every),
            spread=spread(every),
        )


def execute(
    model: Model,
    controller: Path,
    trajectory: Trajectory,
    settings: ExecutionSettings = ExecutionSettings(),
    *,
    hidden: Sequence[Hidden] = (),
    changed: Sequence[Hidden] = (),
    board: Callable[[Path, str, int], Board] = HostBoard,
    listening: Callable[[], AbstractContextManager[Callable[[], int]]] = lambda: nullcontext(lambda: 0),
) -> Execution:
    """The trajectory on a simulated arm, from rest, until all trials are done or one is stopped.

    controller       directory of the arm's compiled controller, for this kind of board
    hidden, changed  effects of the arm that the model does not have, or has with other values
    board            drives the arm: made from directory, name and number of joints
    listening        context in which the arm moves: how often the user wants to stop; see Session.run
    Raises ControllerError, ModelError, PlantError, SimulationError, LinkError, LinkLost.
    """
    compensated = settings.compensates(trajectory, model.controller)
    board_settings = Settings.of(controller, model, trajectory, friction=compensated, tracking=settings.tracking_limit)
    plan = PlannedCycle(model, trajectory)
    seconds = length(trajectory, settings.cycles)
    trials = TRIALS if settings.trials is None else settings.trials
    if (periods := trials * round(seconds / board_settings.dt)) > MOST_SAMPLES:
        raise ControllerError(
            f"{trials} trials of {seconds:.6g} s are {periods} control periods; expected at most {MOST_SAMPLES}, as "
            "many as a recording may have; lower --cycles or --trials"
        )
    values = true_effects(model, plan.terms, changed, hidden)
    if hidden or changed:
        # Default values are chosen for one cycle; all cycles are alike.
        t = np.arange(round(length(trajectory, 1) * RATE)) / RATE
        values = complete(model, trajectory.at(model, t).q, values)
    excess = tuple(plan.exceeded())
    arm = SimulatedArm(Plant(model, values, board_settings.dt), board_settings)
    done: list[Trial] = []
    sums: BoardSums | None = None
    if not excess:
        line = Lockstep(board(controller, model.name, model.n), arm, board_settings.dt)
        session = Session(line, Codec.from_json(controller / "protocol.json"))
        try:
            line.start(plan.motion.q[:, 0], np.random.default_rng([settings.seed, 0]))
            session.identify()
            session.upload(board_settings)
            with listening() as asked, steps("trials", trials) as step:
                while len(done) < trials and not (done and done[-1].stop):
                    line.start(plan.motion.q[:, 0], np.random.default_rng([settings.seed, len(done)]))
                    done.append(run(session, board_settings, seconds, asked=asked))
                    step()
            sums = session.blocks.sums(model.name)
        finally:
            session.close()
    return Execution(
        plan=plan,
        dt=board_settings.dt,
        compensated=compensated,
        uncompensated=board_settings.uncompensated,
        arm=values,
        hidden=frozenset(item.term for item in hidden),
        seed=settings.seed,
        noise=settings.noise,
        excess=excess,
        trials=tuple(done),
        sums=sums,
    )

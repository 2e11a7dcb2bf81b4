"""A trajectory executed on what `--on` names: the simulated arm, or a real one, which is simulated first."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from msgspec import UnsetType, json, structs

from runtime.documents.generated import BuildEntry
from runtime.documents.plans import BoardEntry, ExecuteDocument, ImageEntry, PredictionEntry
from runtime.execution import real
from runtime.execution.execute import SIMULATED, Execution, execute
from runtime.execution.motions import PlayedMotion
from runtime.execution.options import ExecutionSettings
from runtime.execution.real import ArmLine, Setup
from runtime.hardware.link import BoardLink, LinkError, LinkLost
from runtime.hardware.lockstep import Board, Fault
from runtime.hardware.settings import ControllerError
from runtime.interruption import listening
from runtime.model.loader import Model
from runtime.planning.trajectory import Trajectory
from runtime.simulation.simulate import Hidden


def line_of(on: str) -> ArmLine | None:
    """The link to a real arm that an address names; None: a simulated one. Raises LinkError."""
    if on in SIMULATED:
        return None
    line = real.LINES.get(real.scheme(on))
    if line is None:
        meant = f"; did you mean serial://{on}?" if on.startswith("/dev/") else ""
        raise LinkError(f"--on {on}: no such target; there is: {', '.join(real.KNOWN)}{meant}")
    line.parse(on)
    return line


def check_options(on: str, *, moves: bool, approach: bool, hidden: object, changed: object) -> None:
    """Raise ControllerError if an option does not apply to the target, LinkError if there is no such target."""
    if line_of(on) is None:
        if moves or approach:
            raise ControllerError(f"--{'arm' if moves else 'approach'} is for a real arm, and --on {on} is none")
    elif hidden or changed:
        raise ControllerError(f"--{'hide' if hidden else 'set'} is for the simulated arm, and --on {on} is a real one")


def build_of(on: str) -> str:
    """The target of the firmware that runs there, of `tendon firmware`; for a real arm the one that predicts it."""
    return SIMULATED[on if on in SIMULATED else "simulation"].build


def is_roomy(on: str) -> bool:
    """Whether the controller there has this computer's memory, and with it room for long motions."""
    line = line_of(on)
    return line is None or line.on_this_computer


def check(on: str, model: Model) -> None:
    """Raise ControllerError or LinkError if the model does not suffice for the target; nothing is opened."""
    if (line := line_of(on)) is not None:
        real.check_limits(model)
        line.check(on, model)


@dataclass(frozen=True)
class Order:
    """An arm, its trajectory and how it is executed.

    controller       directory of the arm's compiled controller, for `build_of` the target
    hidden, changed  effects of the simulated arm that the model does not have, or has with other values
    moves            whether a real arm may move; without it the motion is only predicted
    ready            called with the prediction, before a real arm moves
    working          shows what is done as long as it is done
    played           the motion's file that the trajectory was made of
    """

    model: Model
    controller: Path
    plan: Trajectory
    settings: ExecutionSettings
    hidden: Sequence[Hidden] = ()
    changed: Sequence[Hidden] = ()
    moves: bool = False
    ready: Callable[[PredictionEntry], None] = lambda _: None
    working: Callable[[str], AbstractContextManager[Any]] = lambda _: nullcontext()
    played: PlayedMotion | None = None

    def run(self, on: str) -> tuple[Execution, ExecuteDocument]:
        """The execution on this target, and every figure of it.

        Raises ControllerError, ModelError, PlantError, SimulationError, LinkError, LinkLost.
        """
        done, document = self._run(on)
        document = structs.replace(document, on=on, speed=self.settings.speed)
        if (played := self.played) is not None:
            document = structs.replace(document, unchecked=played.unchecked, played=played.document(self.plan))
        return done, document

    def _run(self, on: str) -> tuple[Execution, ExecuteDocument]:
        if (line := line_of(on)) is not None:
            return self._real(line, on)
        done = self._simulated(self._asked, SIMULATED[on].board)
        build = json.decode((self.controller / "image.json").read_bytes(), type=BuildEntry)
        image = None  # a board of this computer has none
        if not isinstance(build.text, UnsetType):
            image = ImageEntry(target=build.target, compiler=build.toolchain.version, text=build.text)
        return done, structs.replace(done.document(), image=image)

    @property
    def _asked(self) -> ExecutionSettings:
        return self.settings if self.played is None else replace(self.settings, trials=self.settings.trials or 1)

    def _simulated(self, settings: ExecutionSettings, board: Callable[[Path, str, int], Board]) -> Execution:
        with self.working(f"executing {self.plan.scenario} on the simulated arm"):
            return execute(
                self.model,
                self.controller,
                self.plan,
                settings,
                hidden=self.hidden,
                changed=self.changed,
                board=board,
                listening=listening,
            )

    def _real(self, line: ArmLine, on: str) -> tuple[Execution, ExecuteDocument]:
        """Simulated first, and moved only if that was completed and `moves`."""
        simulated = self._simulated(replace(self.settings, trials=1), SIMULATED["simulation"].board)
        nothing = replace(simulated, trials=())
        if not simulated.completed:
            reason = f"the simulated arm did not complete it: {simulated.reason}"
            return nothing, structs.replace(nothing.document(), status="refused", reason=reason)
        predicted = real.prediction(simulated)
        if not self.moves:
            reason = "a real arm moves only with --arm (in Python: move=True), and nobody in its reach"
            refused = structs.replace(nothing.document(), status="refused", reason=reason)
            return nothing, structs.replace(refused, prediction=predicted, board=self._look(line, on))
        link, setup = self._connect(line, on)
        with self.working(f"executing {self.plan.scenario} on {on}"), listening() as stop:
            done, frames = real.execute_on(link, setup, lambda: self.ready(predicted), stop)
        found = structs.replace(done.document(), prediction=predicted, every=setup.every, link=frames)
        if drives := link.figures():
            found = structs.replace(found, drives=drives)
        if done.completed and link.fault:
            # Something failed after the motion, such as drives that stay powered.
            found = structs.replace(found, status="stopped", reason=link.fault)
        return done, found

    def _connect(self, line: ArmLine, on: str) -> tuple[BoardLink, Setup]:
        link = line.open(on, self.model, self.controller)
        every = real.decimation(self.controller, self.model, link.baud)
        return link, Setup(
            directory=self.controller,
            model=self.model,
            trajectory=self.plan,
            settings=self.settings,
            every=every,
            late=link.late,
        )

    def _look(self, line: ArmLine, on: str) -> BoardEntry:
        try:
            return BoardEntry(standing=real.standing(*self._connect(line, on)), text=None)
        except (LinkError, LinkLost, Fault) as error:
            return BoardEntry(standing=None, text=str(error))

"""`tendon init --scenario`: a task from point to point, written as a scenario for `tendon optimize`."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from runtime.cli.inputs import opened
from runtime.cli.output import emit
from runtime.documents.models import InitScenarioDocument
from runtime.planning.settings import LONGEST_CYCLE, SHORTEST_CYCLE
from runtime.setting import Checked, Setting
from runtime.workspace.names import UsageError, is_name

if TYPE_CHECKING:
    from runtime.model.loader import Model
    from runtime.planning.new_scenario import PointToPoint
    from runtime.workspace.source import Source


OF_TASK: Mapping[str, str] = {
    "from": "where the motion begins, a position for each joint, rad or m, or tip=X,Y, m",
    "to": "where it turns or ends, a position for each joint, rad or m, or tip=X,Y, m",
    "duration": "the duration of the whole motion, s",
    "springs": "joints that may have a parallel spring, such as 2,3, or none",
}
"""What a task needs, by option."""


@dataclass(frozen=True)
class TaskOptions(Checked):
    """What the command line states of a task, as text."""

    from_: Annotated[str | None, Setting("With --scenario: where the motion begins.", metavar="Q1,...|tip=X,Y")] = None
    via: Annotated[list[str] | None, Setting("A point on the way; repeatable.", metavar="Q1,...|tip=X,Y")] = None
    to: Annotated[str | None, Setting("Where it turns, or ends.", metavar="Q1,...|tip=X,Y")] = None
    duration: Annotated[str | None, Setting("Duration of the whole motion, s.", metavar="S")] = None
    springs: Annotated[
        str | None, Setting("Joints that may have a parallel spring; none for none.", metavar="JOINT,...")
    ] = None
    once: Annotated[bool, Setting("From --from to --to once; otherwise there and back, over and over.")] = False
    plate: Annotated[bool, Setting("Press --to into the plate of the model file.")] = False

    @property
    def stated(self) -> dict[str, str]:
        """What is stated, by option."""
        texts = {key.rstrip("_"): value for key, value in asdict(self).items()}
        return {key: texts[key] for key in OF_TASK if texts[key] is not None}


NO_TASK = TaskOptions()


def init_scenario(
    model: Path, out: Path | None, options: TaskOptions, *, effects: Path | None, json: str | None
) -> None:
    """Write the scenario. Raises UsageError, ModelError."""
    from runtime import files
    from runtime.planning import new_scenario
    from runtime.report import models, terminal

    path = Path("task.toml") if out is None else out
    if path.exists():
        raise UsageError(f"{path}: already exists; choose another name with --out")
    source = opened(model, effects)
    with terminal.working("deriving and compiling the model"):
        loaded = source.compiled.model()
    loaded.lump_values  # noqa: B018  raises if masses or rotors are unknown

    begun, stated = _Begun(source, loaded, path, options), options.stated
    begun.checked(stated)
    task = begun.task(stated, model)
    text = new_scenario.scenario_text(loaded, task)
    _check(text, path, loaded)
    files.replace(path, text.encode())
    document = InitScenarioDocument(
        out=str(path),
        name=task.name,
        model=task.model,
        seconds=task.seconds,
        points={p.name: list(p.q or p.tip) for p in task.points},
        springs=list(task.springs),
    )
    emit(json, document, terminal.printer(models.begun_scenario))


def _check(text: str, path: Path, model: Model) -> None:
    """The scenario is one for this arm. Raises ModelError."""
    import tomllib

    from runtime.planning import scenario_file
    from symbolic.model_file.checks import Place, printable

    asked = scenario_file.parse(tomllib.loads(text), Place(printable(str(path))))
    scenario_file.fitted(asked, model, str(path))


@dataclass(frozen=True)
class _Begun:
    """What turns options into a task."""

    source: Source
    model: Model
    path: Path
    options: TaskOptions

    def checked(self, stated: Mapping[str, str]) -> None:
        """Each option by itself. Raises UsageError, ModelError."""
        from runtime.planning.new_scenario import point

        for key in ("from", "to"):
            if key in stated:
                point(self.model, f"--{key}", stated[key])
        for text in self.options.via or ():
            point(self.model, "--via", text)
        if "duration" in stated:
            _seconds(stated["duration"])
        if "springs" in stated:
            self._springs(stated["springs"])

    def task(self, stated: Mapping[str, str], model: Path) -> PointToPoint:
        """The task of all options. Raises UsageError."""
        from runtime.planning.new_scenario import PointToPoint, point

        for key, needed in OF_TASK.items():
            if key not in stated:
                raise UsageError(f"--{key} is needed: {needed}")
        between = [point(self.model, f"via_{k}", text) for k, text in enumerate(self.options.via or (), 1)]
        points = (point(self.model, "start", stated["from"]), *between, point(self.model, "end", stated["to"]))
        named = str(model) if is_name(model) else os.path.relpath(model, self.path.parent)
        return PointToPoint(
            name=_identifier(self.path.stem),
            model=named,
            points=points,
            seconds=_seconds(stated["duration"]),
            back=not self.options.once,
            springs=self._springs(stated["springs"]),
            plate=self.options.plate,
            friction=self._friction_known(),
        )

    def _springs(self, text: str) -> tuple[int, ...]:
        if text.strip().lower() == "none":
            return ()
        numbers = tuple(self.source.joint_number(part.strip()) for part in text.split(","))
        if len(set(numbers)) < len(numbers):
            raise UsageError(f"--springs {text}: names a joint twice; at most one spring for each")
        return numbers

    def _friction_known(self) -> bool:
        from runtime.model.terms import check_complete, structure
        from symbolic.model_file.checks import ModelError

        try:
            check_complete(self.model, structure(self.model))
        except ModelError:
            return False
        return True


def _seconds(text: str) -> float:
    try:
        seconds = float(text)
    except ValueError:
        seconds = 0.0
    if not SHORTEST_CYCLE <= seconds <= LONGEST_CYCLE:
        raise UsageError(
            f"--duration {text}: expected the duration of the whole motion, {SHORTEST_CYCLE:g} to {LONGEST_CYCLE:g} s"
        )
    return seconds


def _identifier(stem: str) -> str:
    from symbolic.model_file.exchange.importing import arm_name

    return arm_name(stem, Path("task"))

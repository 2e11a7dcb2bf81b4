"""Model file and recordings of a verb, read and checked before any work that takes time."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from runtime.cli.output import command_line
from runtime.documents.provenance import InputFile, Provenance
from runtime.workspace.names import UsageError, arm_path, column_mapping, is_name
from runtime.workspace.source import Source
from runtime.workspace.writing import check_writable
from symbolic.model_file.arm import LINK_TORQUE

if TYPE_CHECKING:
    from runtime.model.loader import Model
    from runtime.recordings.recording import Recording
    from runtime.report.summary import Invocation


def opened(model: Path, effects: Path | None) -> Source:
    """A model file; its notes go to standard error. Raises ModelError, UsageError."""
    source = Source.read(model, effects)
    print_notes(source)
    return source


def print_notes(source: Source) -> None:
    """Print the notes of a model file on standard error, because standard output may be JSON."""
    for note in source.arm().notes:
        print(note, file=sys.stderr)


@dataclass(frozen=True)
class TypedInputs:
    """Model file and recordings as they were typed.

    held_out   recordings that are not fitted      maps   entries of --map and --columns
    """

    model: Path
    recordings: Sequence[Path]
    held_out: Sequence[Path] = ()
    effects: Path | None = None
    maps: Sequence[str] | None = None
    allow_gaps: bool = False

    def read(self) -> tuple[Source, list[Recording], Model]:
        """Model file, recordings (those held out are last) and compiled model; notes go to standard error."""
        from runtime.inspection.inspection import by_signals
        from runtime.report.terminal import working

        columns = column_mapping(self.maps)
        source = opened(self.model, self.effects)
        data = source.recordings([*self.recordings, *self.held_out], columns, self.allow_gaps)
        for recording in data:
            for note in (*recording.notes, *map(str, by_signals(recording))):
                print(f"{recording.path}: {note}", file=sys.stderr)
        with working("deriving and compiling the model"):
            model = source.compiled.model()
        return source, self._with_gains(model, data), model

    def _with_gains(self, model: Model, data: list[Recording]) -> list[Recording]:
        """Recordings with torques of identified drives; what is told of them goes to standard error."""
        if not any(recording.gains_open for recording in data):
            return data
        from runtime.identification.drive_gains import with_gains
        from runtime.recordings.driven import told_notes
        from runtime.recordings.recording import drives_of
        from runtime.report.terminal import working

        with working("identifying the drives"):
            found = with_gains(model, data, len(self.recordings))
        for note in told_notes(drives_of(found[: len(self.recordings)])):
            print(f"{self.model}: {note}", file=sys.stderr)
        return found

    def check_side(self, source: Source, data: Sequence[Recording]) -> None:
        """Refuse to write what torques without a scale say, or what torques at the link say into a model file of the
        motors', or the other way round: friction and rotors are in one of them. Raises UsageError."""
        of_file = source.arm().torque == LINK_TORQUE
        for recording in data:
            for number, joint in enumerate(recording.driven, 1):
                if joint is not None and joint.without_scale:
                    raise UsageError(
                        f"{recording.path}: nothing known gives the scale of joint {number}'s torque: nothing is "
                        f"written; state {joint.without_scale} under its [joint.drive], or the inertia or weight that "
                        "it moves"
                    )
            if (recording.torque == LINK_TORQUE) != of_file:
                where, other = ("the motor", "the link") if of_file else ("the link", "the motor")
                stated = "leave the torque out of" if of_file else f'state torque = "{LINK_TORQUE}" in'
                raise UsageError(
                    f"{recording.path}: its torque is that at {where}, and the model file is for that at {other}: "
                    f"nothing is written; {stated} a copy of {source.path}, and write into that"
                )

    def provenance(self, verb: str, source: Source) -> Provenance:
        """What a result of a verb is made from, before it is made. Raises OSError."""
        return made_from(
            verb,
            self.model,
            source,
            self.recordings,
            self.held_out,
            effects=self.effects,
            maps=self.maps or (),
            allow_gaps=self.allow_gaps,
        )

    def invocation(self, source: Source, provenance: Provenance, improved: Path | None = None) -> Invocation:
        """For the commands that a result proposes; improved: file of the improved model."""
        from runtime.report.summary import Invocation, about

        named = is_name(self.model)
        return Invocation(
            Path(f"{self.model}.toml") if named else self.model,
            tuple(self.recordings),
            tuple(self.held_out),
            effects=self.effects,
            maps=tuple(self.maps or ()),
            allow_gaps=self.allow_gaps,
            improved=improved,
            about=about(source.text),
            like=str(self.model) if named else None,
            provenance=provenance,
        )


def made_from(
    verb: str,
    model: Path | None,
    source: Source | None,
    recordings: Sequence[Path] = (),
    held_out: Sequence[Path] = (),
    *,
    further: Sequence[Path] = (),
    effects: Path | None = None,
    maps: Sequence[str] = (),
    allow_gaps: bool = False,
) -> Provenance:
    """What a result of the command that runs is made from, before it is made.

    model     as it was typed     source   as it was read; None, both: there is none
    further   a scenario, a trajectory or a motion
    Raises OSError.
    """
    return Provenance.of(
        verb,
        None if model is None else InputFile.of(model, arm_path(model)),
        None if source is None else source.text,
        map(InputFile.of, recordings),
        map(InputFile.of, held_out),
        command=command_line(),
        effects=None if effects is None else InputFile.of(effects),
        maps=maps,
        allow_gaps=allow_gaps,
        further=map(InputFile.of, further),
    )


def check_hidden(source: Source, option: str, texts: Sequence[str]) -> None:
    """Check the values of --hide, --set or --between before the model is compiled. Raises SimulationError."""
    if not texts:
        return
    from runtime.simulation.simulate import hidden_in

    arm = source.arm()
    for text in texts:
        hidden_in(text, source.effects, [joint.name for joint in arm.joints], arm.name, option=option)


def check_own(model: Path) -> None:
    """Refuse to write into a model file that comes with Tendon or cannot be written. Raises UsageError."""
    if is_name(model):
        raise UsageError(
            f"{model}: comes with Tendon and is not changed; make a copy of it first: "
            f"tendon init --like {model} --out {model}.toml"
        )
    check_writable(model)

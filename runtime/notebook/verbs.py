"""The verbs of the command line as functions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.diagnosis import stages
from runtime.diagnosis.credibility import judged
from runtime.diagnosis.settings import BUDGET
from runtime.documents.provenance import InputFile, Provenance
from runtime.identification import compare as comparison
from runtime.identification import identify as identification
from runtime.identification.drive_gains import with_gains
from runtime.inspection import inspection
from runtime.loop import improve as loop
from runtime.notebook.arm import LoadedArm, PathOrText, Recorded
from runtime.notebook.results import (
    ComparisonResult,
    DiagnosisResult,
    IdentificationResult,
    ImprovementResult,
    InspectionResult,
)
from runtime.recordings import in_memory
from runtime.recordings.recording import Recording
from runtime.report import diagnosed
from runtime.report.summary import Invocation, ResultSummary, about
from runtime.simulation.options import SimulationSettings
from runtime.workspace.names import ARMS

Recordings = Recorded | Sequence[Recorded]


def read_both(
    arm: LoadedArm, recordings: Recordings, held_out: Recordings = ()
) -> tuple[list[Recording], list[Recording]]:
    """Recordings to be fitted and those held out, with torques of drives whose gains are identified."""
    fitted, held = arm.recordings(recordings), arm.recordings(held_out)
    if any(recording.gains_open for recording in fitted):
        found = with_gains(arm.model, [*fitted, *held], len(fitted))
        return found[: len(fitted)], found[len(fitted) :]
    return fitted, held


def identify(arm: LoadedArm, recordings: Recordings, skew: float | None = None) -> IdentificationResult:
    """Fit the parameters of the arm's structure to recordings.

    skew   samples by which the torque leads the motion; None: estimated
    """
    data, _ = read_both(arm, recordings)
    found = judged(identification.identify(arm.model, data, skew), data)
    return IdentificationResult(found, arm.with_text(arm.source.edits.set(diagnosed.judged(found)).text))


def compare(arm: LoadedArm, recordings: Recordings) -> ComparisonResult:
    """Where does the model fail? The residual of every joint, and what it follows."""
    data, _ = read_both(arm, recordings)
    result = comparison.compare(arm.model, data)
    return ComparisonResult(result, ResultSummary(result, _invocation("compare", arm, data)))


def diagnose(arm: LoadedArm, recordings: Recordings, budget: int = BUDGET) -> DiagnosisResult:
    """Which physical effect is missing? `result.verdict` is "effect", "clean", "unexplained" or "refused";
    budget: refits that the search may try."""
    data, _ = read_both(arm, recordings)
    result = stages.diagnose(arm.model, data, budget=budget)
    return DiagnosisResult(result, ResultSummary(result, _invocation("diagnose", arm, data)))


def improve(
    arm: LoadedArm, recordings: Recordings, held_out: Recordings = (), budget: int = BUDGET
) -> ImprovementResult:
    """Add what is missing, as long as it helps, judged on what was not fitted; `result.arm` is the improved one;
    budget: refits that the search may try."""
    fitted, held = read_both(arm, recordings, held_out)
    result = loop.improve(arm.source, fitted, held, budget=budget)
    floors = loop.floors(result.steps[-1].fit, held)
    summary = ResultSummary(result, _invocation("improve", arm, fitted, held), floors)
    return ImprovementResult(result, summary, arm.with_text(result.model_text))


def add(arm: LoadedArm, effect: str, joint: int | str | None = None) -> LoadedArm:
    """The arm with an effect more, its values unknown until they are identified. Nothing is written.

    joint   from 1, or a name that the model file gives; None for effects of the arm or the contact
    """
    number = arm.source.joint_number(joint) if isinstance(joint, str) else joint
    return arm.with_text(arm.source.edits.add(effect, number).text)


def simulate(
    arm: LoadedArm,
    hide: str | Sequence[str] = (),
    seed: int = SimulationSettings.seed,
    seconds: float = SimulationSettings.seconds,
    motion: PathOrText | NDArray[np.float64] | None = None,
    repeats: int = SimulationSettings.repeats,
    noise: float = SimulationSettings.noise,
    signals: str = SimulationSettings.signals,
) -> Recording:
    """A recording of the model itself, at 1 kHz, to try a diagnosis on; inertias that its file leaves out are likely
    ones.

    hide      effects that the model file does not have: "stribeck@1" or "stribeck@1:torque=0.6,speed=0.15"
    seconds   length of the motion, in `repeats` equal parts; or `motion`, positions (N, n) or (n, N) at 1 kHz or a CSV
    noise     standard deviation of the torque's noise, part of the torque's rms
    signals   further ones that are recorded: q_link, tau_link, temperature
    """
    from runtime.simulation import simulate as simulation  # CasADi
    from runtime.simulation.commands import commanded
    from runtime.simulation.motion_file import read_motion

    model = arm.source.compiled.with_likely_numbers()[0].model()
    hidden = [simulation.parse_hidden(text, model) for text in ([hide] if isinstance(hide, str) else hide)]
    path = read_motion(Path(motion), model.n) if isinstance(motion, str | PathLike) else motion
    if path is not None and path.shape[-1:] == (arm.n,):
        path = np.ascontiguousarray(path.T)
    settings = SimulationSettings(seed, seconds, repeats, noise=noise, signals=signals)
    made, _ = simulation.simulate(model, hidden, settings, path, arm.source.arm().torque)
    return commanded(made, model.joints)


def inspect(
    source: Recording | PathOrText | Any,
    arm: LoadedArm | None = None,
    columns: Mapping[str, str] | None = None,
    allow_gaps: bool = False,
) -> InspectionResult:
    """What is in a recording, what looks wrong with it, and how well it determines the arm's parameters.

    source   a recording, or what `recording` reads: a file, a data frame, a dict of columns
    arm      for the checks that need a model
    columns, allow_gaps   as for `recording`
    Raises ValueError if it is no recording at all.
    """
    joints = None if arm is None else arm.source.recorded_arm()
    if isinstance(source, Recording):
        names = tuple(joint.name for joint in joints.joints) if joints else ()
        found = inspection.Inspection(source.path, in_memory.of_recording(source), source, problem=None, names=names)
    elif isinstance(source, str | PathLike):
        found = inspection.inspect(Path(source), joints, columns or {}, allow_gaps)
    else:
        refuse = in_memory.RefusedArrays("recording")
        contents = in_memory.of_frame(source, columns or {}, refuse)
        found = inspection.of_contents(contents, Path("recording"), joints, columns or {}, allow_gaps, refuse=refuse)
    return InspectionResult(found if arm is None else inspection.with_model(found, arm.model))


def _invocation(
    verb: str, arm: LoadedArm, fitted: Sequence[Recording], held_out: Sequence[Recording] = ()
) -> Invocation:
    """What the same would be on the command line, for the commands that follow from a result, and what it was made
    from."""
    path = arm.source.path
    named = path.parent == ARMS
    return Invocation(
        Path(path.name) if named else path,
        tuple(r.path for r in fitted),
        tuple(r.path for r in held_out),
        about=about(arm.text),
        like=path.stem if named else None,
        provenance=Provenance.of(
            verb,
            InputFile.of(path),
            arm.text,
            [InputFile.of(r.path) for r in fitted],
            [InputFile.of(r.path) for r in held_out],
        ),
    )

"""The verbs of the command line as functions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from runtime.diagnosis import stages
from runtime.diagnosis.credibility import judged
from runtime.diagnosis.settings import BUDGET_S
from runtime.identification import compare as comparison
from runtime.identification import identify as identification
from runtime.loop import improve as loop
from runtime.notebook.arm import LoadedArm, PathOrText, Recorded
from runtime.notebook.results import (
    ComparisonResult,
    DiagnosisResult,
    ExportResult,
    IdentificationResult,
    ImprovementResult,
    PlanResult,
)
from runtime.planning import optimize as optimizer
from runtime.planning import scenario_file
from runtime.planning.settings import PlanningSettings
from runtime.recordings.recording import Recording
from runtime.report import diagnosed
from runtime.report.summary import Invocation, ResultSummary, about
from runtime.simulation import simulate as simulation
from runtime.simulation.options import SimulationSettings
from runtime.workspace import exporting
from runtime.workspace.names import scenario_path
from runtime.workspace.source import Source, effects_described, effects_library, scenario_source
from symbolic.model_file.exchange.importing import imported

Recordings = Recorded | Sequence[Recorded]


def identify(arm: LoadedArm, recordings: Recordings, skew: float | None = None) -> IdentificationResult:
    """Fit the parameters of the arm's structure to recordings.

    skew   samples by which the torque leads the motion; None: estimated
    """
    data = arm.recordings(recordings)
    found = judged(identification.identify(arm.model, data, skew), data)
    return IdentificationResult(found, arm.with_text(arm.source.edits.set(diagnosed.judged(found)).text))


def compare(arm: LoadedArm, recordings: Recordings) -> ComparisonResult:
    """Where does the model fail? The residual of every joint, and what it follows."""
    data = arm.recordings(recordings)
    result = comparison.compare(arm.model, data)
    return ComparisonResult(result, ResultSummary(result, _invocation(arm, data)))


def diagnose(arm: LoadedArm, recordings: Recordings, budget: float = BUDGET_S) -> DiagnosisResult:
    """Which physical effect is missing? `result.verdict` is "effect", "clean", "unexplained" or "refused"; budget: s,
    that it may take."""
    data = arm.recordings(recordings)
    result = stages.diagnose(arm.model, data, wider=arm.source.compiled.model_with_guesses, budget=budget)
    return DiagnosisResult(result, ResultSummary(result, _invocation(arm, data)))


def improve(
    arm: LoadedArm, recordings: Recordings, held_out: Recordings = (), budget: float = BUDGET_S
) -> ImprovementResult:
    """Add what is missing, as long as it helps, judged on what was not fitted; `result.arm` is the improved one;
    budget: s, that it may take."""
    fitted, held = arm.recordings(recordings), arm.recordings(held_out)
    result = loop.improve(arm.source, fitted, held, budget=budget)
    floors = loop.floors(result.steps[-1].fit, held)
    summary = ResultSummary(result, _invocation(arm, fitted, held), floors)
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
    """A recording of the model itself, at 1 kHz, to try a diagnosis on.

    hide      effects that the model file does not have: "stribeck@1" or "stribeck@1:torque=0.6,speed=0.15"
    seconds   length of the motion, in `repeats` equal parts; or `motion`, positions (n, N) at 1 kHz or a CSV
    noise     standard deviation of the torque's noise, part of the torque's rms
    signals   further ones that are recorded: q_link, tau_link, temperature
    """
    hidden = [simulation.parse_hidden(text, arm.model) for text in ([hide] if isinstance(hide, str) else hide)]
    path = (
        motion
        if motion is None or isinstance(motion, np.ndarray)
        else simulation.read_motion(Path(motion), arm.model.n)
    )
    settings = SimulationSettings(seed, seconds, repeats, noise=noise, signals=signals)
    made, _ = simulation.simulate(arm.model, hidden, settings, path)
    return made


def import_(
    path: PathOrText,
    base: str | None = None,
    tip: str | None = None,
    lock: Mapping[str, float] | None = None,
    friction: bool = True,
    effects: PathOrText | None = None,
) -> LoadedArm:
    """The arm of a URDF or MJCF file; `arm.notes` says what was left out of it, `arm.save(path)` writes the model file.

    base, tip   links between which it lies; None: the root, and the only end
    lock        joint -> where it is held, rad or m
    friction    dry and viscous friction at every joint, unknown where the file states none
    Raises ValueError.
    """
    own = None if effects is None else Path(effects)
    made = imported(Path(path), effects_described(own, space=True), base, tip=tip, locked=lock, friction=friction)
    library = effects_library(own, space=True) if own else None
    return LoadedArm(Source(Path(f"{made.arm.name}.toml"), made.text, library), made.notes)


def export(
    arm: LoadedArm, path: PathOrText, to: Literal["urdf", "mjcf"] = "urdf", onto: PathOrText | None = None
) -> ExportResult:
    """Write the arm as URDF or MJCF, with physically possible bodies. Raises ValueError, OSError.

    onto   a URDF of the arm: the new file is a copy of it, with the model's numbers in it
    """
    return ExportResult(exporting.export(arm.source.compiled, to, Path(path), None if onto is None else Path(onto)))


def optimize(
    scenario: PathOrText,
    cycle_time: float | None = None,
    friction: bool | None = None,
    springs: bool = True,
    starts: int | None = PlanningSettings.starts,
    seed: int = PlanningSettings.seed,
    effects: PathOrText | None = None,
) -> PlanResult:
    """Plan motion and springs together; the arm is the one that the scenario names.

    scenario     a file, or the name of one of Tendon's (scenario1, scenario2)
    cycle_time   s, and friction: in place of the file's     springs: with the file's, or bare
    starts       random first guesses; None: few     Raises Infeasible if no motion meets all constraints.
    """
    path = scenario_path(Path(scenario))
    asked = scenario_file.read(path)
    source = scenario_source(asked.model, path, None if effects is None else Path(effects))
    arm = LoadedArm(source)
    case = scenario_file.fitted(asked, arm.model, str(path))
    case = case if springs else case.without_springs()
    case = replace(
        case,
        cycle_time=case.cycle_time if cycle_time is None else cycle_time,
        friction=case.friction if friction is None else friction,
    )
    plan = optimizer.optimize(arm.model, case, PlanningSettings(starts, seed))
    return PlanResult(plan, arm.with_text(source.edits.mount(plan.trajectory).text))


def _invocation(arm: LoadedArm, fitted: Sequence[Recording], held_out: Sequence[Recording] = ()) -> Invocation:
    """What the same would be on the command line, for the commands that follow from a result."""
    return Invocation(
        arm.source.path,
        tuple(r.path for r in fitted),
        tuple(r.path for r in held_out),
        about=about(arm.text),
    )

"""Tendon for notebooks and scripts: the verbs of the command line, with their names and results.

    import tendon

    arm = tendon.load("drive.toml")
    run = tendon.recording("run1.csv", arm)
    result = tendon.diagnose(arm, run)  # printed, a few lines; result.figures draw themselves
    better = tendon.improve(arm, run, held_out="run2.csv")
    better.save("better.toml")

Errors are ValueErrors whose message is the line that the command line prints.
"""

from runtime.notebook.arm import LoadedArm as Arm
from runtime.notebook.arm import load, recording
from runtime.notebook.results import (
    ComparisonResult,
    DiagnosisResult,
    ExportResult,
    IdentificationResult,
    ImprovementResult,
    PlanResult,
)
from runtime.notebook.verbs import add, compare, diagnose, export, identify, import_, improve, optimize, simulate
from runtime.planning.optimize import Infeasible
from runtime.recordings.recording import Recording

__all__ = [
    "Arm",
    "ComparisonResult",
    "DiagnosisResult",
    "ExportResult",
    "IdentificationResult",
    "ImprovementResult",
    "Infeasible",
    "PlanResult",
    "Recording",
    "add",
    "compare",
    "diagnose",
    "export",
    "identify",
    "import_",
    "improve",
    "load",
    "optimize",
    "recording",
    "simulate",
]

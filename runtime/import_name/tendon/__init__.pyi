"""The public names, for type checkers and for __init__.py, which imports each when it is first used."""

from codegen.toolchain.build import BuildError as BuildError
from runtime.experiments.asking import ExperimentError as ExperimentError
from runtime.hardware.link import LinkError as LinkError
from runtime.hardware.link import LinkLost as LinkLost
from runtime.hardware.settings import ControllerError as ControllerError
from runtime.model.catalogue import LoaderError as LoaderError
from runtime.notebook.arm import LoadedArm as LoadedArm
from runtime.notebook.arm import load as load
from runtime.notebook.arm import recording as recording
from runtime.notebook.designed import ExperimentResult as ExperimentResult
from runtime.notebook.designed import FirstMotionResult as FirstMotionResult
from runtime.notebook.designed import experiment as experiment
from runtime.notebook.exchanged import ExportedMotionResult as ExportedMotionResult
from runtime.notebook.exchanged import ExportResult as ExportResult
from runtime.notebook.exchanged import export as export
from runtime.notebook.exchanged import export_motion as export_motion
from runtime.notebook.exchanged import import_ as import_
from runtime.notebook.generated import EffectResult as EffectResult
from runtime.notebook.generated import FirmwareResult as FirmwareResult
from runtime.notebook.generated import GenerationResult as GenerationResult
from runtime.notebook.generated import LibraryResult as LibraryResult
from runtime.notebook.generated import VerificationResult as VerificationResult
from runtime.notebook.generated import effects as effects
from runtime.notebook.generated import firmware as firmware
from runtime.notebook.generated import generate as generate
from runtime.notebook.generated import verify as verify
from runtime.notebook.planned import ExecutionResult as ExecutionResult
from runtime.notebook.planned import PlanResult as PlanResult
from runtime.notebook.planned import execute as execute
from runtime.notebook.planned import optimize as optimize
from runtime.notebook.replayed import ReplayResult as ReplayResult
from runtime.notebook.replayed import replay as replay
from runtime.notebook.results import ComparisonResult as ComparisonResult
from runtime.notebook.results import DiagnosisResult as DiagnosisResult
from runtime.notebook.results import IdentificationResult as IdentificationResult
from runtime.notebook.results import ImprovementResult as ImprovementResult
from runtime.notebook.results import InspectionResult as InspectionResult
from runtime.notebook.verbs import add as add
from runtime.notebook.verbs import compare as compare
from runtime.notebook.verbs import diagnose as diagnose
from runtime.notebook.verbs import identify as identify
from runtime.notebook.verbs import improve as improve
from runtime.notebook.verbs import inspect as inspect
from runtime.notebook.verbs import simulate as simulate
from runtime.planning.optimize import Infeasible as Infeasible
from runtime.planning.trajectory import TrajectoryError as TrajectoryError
from runtime.recordings.recording import Recording as Recording
from runtime.recordings.recording import RecordingError as RecordingError
from runtime.setting import SettingError as SettingError
from runtime.simulation.simulate import SimulationError as SimulationError
from runtime.workspace.names import UsageError as UsageError
from symbolic.effects import EffectsError as EffectsError
from symbolic.model_file.checks import ModelError as ModelError

Arm = LoadedArm
__version__: str

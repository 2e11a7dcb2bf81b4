"""Compares C double, C float and CasADi with SymPy for every function of an arm, its controller and every effect.

The SymPy expressions are lowered by the target's rule and evaluated to 50 digits, at inputs that are exact as float:
|error| <= tolerance * sum of |terms|, where the sum includes the condition number of quotients and inverse maps
(Tape.magnitude).
"""

from __future__ import annotations

import ctypes
import functools
import importlib.util
import random
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

import sympy as sp

from codegen import effect_functions as ef
from codegen import render
from codegen.c import c_effects
from codegen.tape.numbering import Lowering
from codegen.tape.tape import Tape
from codegen.toolchain import build
from codegen.verify import reference
from codegen.verify.proof import FunctionProof, prove_model
from codegen.verify.reference import Reference
from symbolic.controller_law import compensation
from symbolic.effects.declaration import SIGNALS, Effect
from symbolic.functions import SymbolicFunction
from symbolic.model import ArmModel, derive
from symbolic.primitives import WIDTHS

if TYPE_CHECKING:
    from symbolic.model_file.arm import Arm


@dataclass(frozen=True)
class Exactness:
    """How exact a target is. tolerance: relative to the sum of |terms|; floor: absolute, for underflow."""

    tolerance: float
    floor: float
    lowering: Lowering = "exact"

    def allowed(self, scale: float) -> float:
        """The largest accepted error; scale: sum of |terms|."""
        return self.tolerance * scale + self.floor


TARGETS = {
    "C double": Exactness(1e-12, 1e-290),
    "C float": Exactness(1e-5, 1e-30),
    "CasADi": Exactness(1e-12, 1e-290, "smooth"),
}
"""Room for some thousand roundings of a double and a hundred of a float."""


@dataclass(frozen=True)
class FunctionCheck:
    """The worst sample of a function on one target. ratio: error/tolerance, at most 1 if equal."""

    function: str
    target: str
    equal: bool
    ratio: float
    error: float
    tolerance: float
    output: str
    expected: float
    found: float
    inputs: Mapping[str, list[float]]


@dataclass(frozen=True)
class Vector:
    """A test vector for firmware: inputs and outputs of one call, and a float's tolerance for each output."""

    function: str
    inputs: Mapping[str, list[float]]
    outputs: Mapping[str, list[float]]
    tolerance: list[float]


@dataclass(frozen=True)
class VerifyReport:
    """Comparisons, proofs and test vectors."""

    arm: str
    samples: int
    seed: int
    cases: tuple[FunctionCheck, ...]
    vectors: tuple[Vector, ...] = field(repr=False)
    proofs: tuple[FunctionProof, ...] = ()

    @property
    def equal(self) -> bool:
        """Whether all comparisons and all proofs hold."""
        return all(case.equal for case in self.cases) and all(proof.equal for proof in self.proofs)

    def to_json(self) -> dict[str, object]:
        """The report. Vectors have decimal numbers and exact C99 hexadecimal floats."""
        return {
            "arm": self.arm,
            "samples": self.samples,
            "seed": self.seed,
            "equal": self.equal,
            "proofs": [{**vars(proof), "equal": proof.equal} for proof in self.proofs],
            "cases": [{key: _finite(value) for key, value in vars(case).items()} for case in self.cases],
            "vectors": [
                {
                    "function": v.function,
                    "inputs": {name: _numbers(values) for name, values in v.inputs.items()},
                    "outputs": {name: _numbers(values) for name, values in v.outputs.items()},
                    "tolerance": v.tolerance,
                }
                for v in self.vectors
            ],
        }


def _finite(value: Any) -> Any:
    return None if isinstance(value, float) and not isfinite(value) else value


def _numbers(values: Sequence[float]) -> dict[str, list[Any]]:
    return {"decimal": list(values), "hex": [value.hex() for value in values]}


Run = Callable[[reference.Values], list[float]]
"""A target's function: values of its symbols -> flat outputs."""


@dataclass(frozen=True)
class Subject:
    """A function, its implementation on each target, and its random arguments.

    branches   all targets switch exactly, as an arm's functions do; else those that have widths for it do it smoothly
    """

    function: SymbolicFunction
    targets: Mapping[str, Run]
    draw: Callable[[random.Random], reference.Values]
    branches: bool = False

    @functools.cached_property
    def rules(self) -> dict[Lowering, tuple[Reference, Tape]]:
        """Reference and tape by rule of lowering."""
        lowerings: tuple[Lowering, ...] = ("exact", "smooth")
        return {rule: (Reference(self.function, rule), Tape.of(self.function, rule)) for rule in lowerings}


def verify(
    arm: Arm,
    samples: int,
    seed: int,
    effects: Iterable[Effect] | None = None,
    each: Callable[[Sequence[Subject]], Iterable[Subject]] = iter,
) -> VerifyReport:
    """Compares all functions of `arm` and of `effects` (None: the library) at `samples` random points each, and proves
    those of a spatial arm.

    each   iterates over the functions, for example to show progress
    Raises ValueError or BuildError if the code cannot be generated or compiled.
    """
    from symbolic.effects import LIBRARY

    chosen = tuple(LIBRARY.values()) if effects is None else tuple(effects)
    library = {**LIBRARY, **{effect.name: effect for effect in chosen}}
    model = derive(arm)
    subjects = [*arm_subjects(model), *controller_subjects(model, library), *effect_subjects(chosen)]
    cases: list[FunctionCheck] = []
    vectors: list[Vector] = []
    for subject in each(subjects):
        rng = random.Random(f"{seed} {subject.function.name}")
        points = [subject.draw(rng) for _ in range(samples)]
        found, vector = compare(subject, points)
        cases += found
        vectors += vector
    proofs = prove_model(model, seed)
    return VerifyReport(arm.name, samples, seed, cases=tuple(cases), vectors=tuple(vectors), proofs=proofs)


def compare(subject: Subject, points: Sequence[reference.Values]) -> tuple[list[FunctionCheck], list[Vector]]:
    """The worst sample of each target, and the first two points as test vectors."""
    function = subject.function
    names = [f"{o.name}[{i}]" if o.shape else o.name for o in function.outputs for i in range(len(o.expressions))]
    lowerings: dict[str, Lowering] = {
        name: "exact" if subject.branches else TARGETS[name].lowering for name in subject.targets
    }
    rules = subject.rules
    truth = {
        rule: [(rules[rule][0](v), rules[rule][1].magnitude(v)) for v in points] for rule in set(lowerings.values())
    }
    cases = []
    for target, run in subject.targets.items():
        worst: FunctionCheck | None = None
        for values, (expected, scales) in zip(points, truth[lowerings[target]], strict=True):
            for name, x, scale, y in zip(names, expected, scales, run(values), strict=True):
                tolerance = TARGETS[target].allowed(scale)
                error = float(abs(x - y))
                ratio = error / tolerance if error == error else float("inf")
                if worst is None or ratio > worst.ratio:
                    worst = FunctionCheck(
                        function=function.name,
                        target=target,
                        equal=ratio <= 1,
                        ratio=ratio,
                        error=error,
                        tolerance=tolerance,
                        output=name,
                        expected=float(x),
                        found=y,
                        inputs=_inputs(function, values),
                    )
        if worst is not None:
            cases.append(worst)
    vectors = [_vector(function, v, *truth["exact"][k]) for k, v in enumerate(points[:2])] if "exact" in truth else []
    return cases, vectors


def _inputs(function: SymbolicFunction, values: reference.Values) -> dict[str, list[float]]:
    return {a.name: [values[s] for s in a.symbols] for a in function.arguments}


def _vector(function: SymbolicFunction, values: reference.Values, flat: list[Any], scales: list[float]) -> Vector:
    outputs, rest = {}, [float(x) for x in flat]
    for o in function.outputs:
        outputs[o.name], rest = rest[: len(o.expressions)], rest[len(o.expressions) :]
    tolerance = [TARGETS["C float"].allowed(scale) for scale in scales]
    return Vector(function.name, _inputs(function, values), outputs, tolerance)


# How each target is run.

_REAL: Mapping[str, type[ctypes.c_double | ctypes.c_float]] = {"f64": ctypes.c_double, "f32": ctypes.c_float}
_TARGET = {"f64": "C double", "f32": "C float"}


def libraries(files: Mapping[str, str], name: str) -> dict[str, ctypes.CDLL]:
    """The compiled functions of one sample, by precision."""

    def library(suffix: str) -> ctypes.CDLL:
        chosen = {path: text for path, text in files.items() if path.endswith((f"_{suffix}.c", f"_{suffix}.h"))}
        return ctypes.CDLL(str(build.shared_library(chosen, f"{name}_{suffix}", build.STRAIGHT)))

    with ThreadPoolExecutor() as pool:
        return dict(zip(_REAL, pool.map(library, _REAL), strict=True))


def casadi_module(files: Mapping[str, str], name: str) -> Any:
    """The generated CasADi module, imported from the cache."""
    path = f"{name}_casadi.py"
    text = files[path]

    def fill(directory: Path) -> None:
        (directory / path).write_text(text, encoding="utf-8")

    spec = importlib.util.spec_from_file_location(
        f"{name}_casadi", build.entry(f"casadi-{build.key(text)}", fill) / path
    )
    if spec is None or spec.loader is None:
        raise ImportError(f"cannot import the generated {path}")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def arm_subjects(model: ArmModel) -> list[Subject]:
    """All functions of the arm on all targets."""
    arm = model.arm
    files = render.arm_files(model)
    compiled, module = libraries(files, arm.name), casadi_module(files, arm.name)
    others = {f.name: f for f in model.functions}

    def subject(function: SymbolicFunction) -> Subject:
        targets = {_TARGET[s]: _arm_call(compiled[s], s, arm.name, function) for s in _REAL}
        targets["CasADi"] = _casadi_call(getattr(module, function.name)(), function, widths=False)
        return Subject(function, targets, lambda rng: reference.arm_values(rng, arm, function, others), branches=True)

    return [subject(function) for function in model.functions]


def _arm_call(library: ctypes.CDLL, suffix: str, arm: str, function: SymbolicFunction) -> Run:
    real = _REAL[suffix]
    kernel = getattr(library, f"{arm}_{function.name}_{suffix}")

    def run(values: reference.Values) -> list[float]:
        arguments = [
            _array(real, a.symbols, values) if a.shape else real(values[a.symbols[0]]) for a in function.arguments
        ]
        outputs = [(real * len(o.expressions))() for o in function.outputs]
        kernel(*arguments, *outputs)
        return [float(x) for output in outputs for x in output]

    return run


def _array(real: Any, symbols: Sequence[sp.Symbol], values: reference.Values) -> Any:
    return (real * max(len(symbols), 1))(*(values[s] for s in symbols))


def controller_subjects(model: ArmModel, library: Mapping[str, Effect]) -> list[Subject]:
    """What the controller adds to the inverse dynamics, in C float."""
    arm = model.arm
    found = compensation(model, library)
    files = render.probe_files(model, library)
    compiled = ctypes.CDLL(str(build.shared_library(files, f"{arm.name}_probe_f32", build.STRAIGHT)))

    def subject(function: SymbolicFunction) -> Subject:
        targets = {_TARGET["f32"]: _arm_call(compiled, "f32", arm.name, function)}
        return Subject(function, targets, lambda rng: reference.controller_values(rng, model, found))

    return [subject(function) for function in found.functions]


def _casadi_call(kernel: Any, function: SymbolicFunction, widths: bool) -> Run:
    groups = [(a.symbols, a.shape) for a in function.arguments]
    if widths:
        groups.append((WIDTHS, (len(WIDTHS),)))

    def run(values: reference.Values) -> list[float]:
        outputs = kernel.call([_matrix([values[s] for s in symbols], shape) for symbols, shape in groups])
        # CasADi counts down the columns, the function along the rows.
        return [float(x) for output in outputs for x in output.T.full().ravel("F")]

    return run


def _matrix(numbers: list[float], shape: tuple[int, ...]) -> Any:
    import casadi

    if len(shape) == 2:
        return casadi.DM(numbers).reshape((shape[1], shape[0])).T
    return casadi.DM(numbers)


def effect_subjects(effects: Sequence[Effect]) -> list[Subject]:
    """Torque, start and step of every effect on every target; the regressor in C double."""
    files = render.effect_files(effects)
    compiled, module = libraries(files, "effects"), casadi_module(files, "effects")
    subjects = []
    for effect in effects:
        functions = [ef.torque(effect)] + ([ef.start(effect), ef.step(effect)] if effect.states else [])
        for function in functions:
            targets = {_TARGET[s]: _effect_call(compiled[s], s, effect, function) for s in _REAL}
            targets["CasADi"] = _casadi_call(getattr(module, function.name)(), function, widths=True)
            subjects.append(_effect_subject(effect, function, targets))
        columns = {"C double": _columns_call(compiled["f64"], effect)}
        subjects.append(_effect_subject(effect, ef.columns(effect), columns))
    return subjects


def _effect_subject(effect: Effect, function: SymbolicFunction, targets: Mapping[str, Run]) -> Subject:
    start = Reference(ef.start(effect))
    first = function.outputs[0].name == "columns"

    def draw(rng: random.Random) -> reference.Values:
        values = reference.effect_values(rng, effect)
        if first:
            # The batch begins in the initial state.
            values |= {s.symbol: float(x) for s, x in zip(effect.states, start(values), strict=True)}
        return values

    return Subject(function, targets, draw)


def _effect_call(library: ctypes.CDLL, suffix: str, effect: Effect, function: SymbolicFunction) -> Run:
    real = _REAL[suffix]
    kernel = getattr(library, f"tendon_{function.name}_{suffix}")
    takes = c_effects.signature(effect, function, Tape.of(function))
    kernel.restype = None if takes.writes_state else real

    def run(values: reference.Values) -> list[float]:
        arguments = [real(values[a.symbols[0]]) for a in takes.inputs]
        state = _array(real, [s.symbol for s in effect.states], values)
        if not takes.writes_state:
            return [float(kernel(*arguments, *([state] if takes.reads_state else [])))]
        kernel(*arguments, state)
        return [float(value) for value in state]

    return run


def _columns_call(library: ctypes.CDLL, effect: Effect) -> Run:
    kernel = getattr(library, f"tendon_{effect.name}_columns_batch_f64")
    rows = 1 + len(effect.columns)

    def run(values: reference.Values) -> list[float]:
        one = [ctypes.c_double(values.get(s.symbol, 0.0)) for s in SIGNALS]
        pointers = (ctypes.c_void_p * len(one))(*(ctypes.addressof(x) for x in one))
        p = _array(ctypes.c_double, [parameter.symbol for parameter in effect.parameters], values)
        out = (ctypes.c_double * rows)()
        kernel(ctypes.c_size_t(1), ctypes.c_size_t(1), pointers, ctypes.c_double(1e-3), p, out)
        return [float(x) for x in out]

    return run

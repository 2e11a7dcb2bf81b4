"""Documents of generated code: generate, add, verify and firmware."""

from __future__ import annotations

from typing import Annotated

from msgspec import UNSET, UnsetType

from runtime.documents.models import ArmName
from runtime.documents.parts import Document, key

Directory = Annotated[str, key("directory of the generated files")]


class OpenEntry(Document, frozen=True, kw_only=True):
    """A number that the model file leaves open."""

    joint: Annotated[int | None, key("its joint, from 1; null: of the whole arm or its contact")]
    parameter: Annotated[str, key("key of the model file; of an effect `effect.parameter`")]
    value: Annotated[float | None, key("what generated code takes for it, 0 for a rotor; null: nothing", "SI")]


class GeneratedFiles(Document, frozen=True, kw_only=True):
    """Generated code of an arm."""

    name: ArmName
    directory: Directory
    effects_directory: Annotated[str, key("directory of the library of effects")]
    files: Annotated[list[str], key("generated files")]
    effects_files: Annotated[list[str], key("files of the library of effects")]
    open: Annotated[list[OpenEntry], key("what the model file leaves open")]
    operations: Annotated[
        dict[str, dict[str, int]], key("operations of each generated function by kind; arithmetic: their sum", "1")
    ]


class GenerateDocument(GeneratedFiles, frozen=True, kw_only=True):
    """What was generated: `tendon generate --json`."""

    stale: Annotated[list[str], key("files that --check found out of date")]


class AddDocument(GeneratedFiles, frozen=True, kw_only=True):
    """What was added and generated: `tendon add --json`."""

    model: Annotated[str, key("path of the model file")]
    added: Annotated[str, key("effect and joint that were added")]


class ProofEntry(Document, frozen=True, kw_only=True):
    """A function of a spatial arm, compared with the Lagrangian in exact arithmetic."""

    function: Annotated[str, key("name of the function")]
    points: Annotated[int, key("random points at which both are equal", "1")]
    differs: Annotated[str | None, key("the first difference; null if there is none")]
    equal: Annotated[bool, key("whether they are equal")]


class ComparedFunction(Document, frozen=True, kw_only=True):
    """A generated function compared with SymPy, at its worst sample."""

    function: Annotated[str, key("name of the function")]
    target: Annotated[str, key("C double, C float or CasADi")]
    equal: Annotated[bool, key("whether all samples are within the tolerance")]
    ratio: Annotated[float | None, key("error over tolerance; null if it is not finite", "1")]
    error: Annotated[float | None, key("absolute error; null if it is not finite", "SI")]
    tolerance: Annotated[float | None, key("allowed error; null if it is not finite", "SI")]
    output: Annotated[str, key("output and its index")]
    expected: Annotated[float | None, key("value of SymPy; null if it is not finite", "SI")]
    found: Annotated[float | None, key("value of the target; null if it is not finite", "SI")]
    inputs: Annotated[dict[str, list[float]], key("inputs by name", "SI")]


class ExactNumbers(Document, frozen=True, kw_only=True):
    """Numbers in two notations."""

    decimal: Annotated[list[float], key("decimal", "SI")]
    hex: Annotated[list[str], key("exact, as C99 hexadecimal floats")]


class TestVector(Document, frozen=True, kw_only=True):
    """Inputs and outputs of one call."""

    function: Annotated[str, key("name of the function")]
    inputs: Annotated[dict[str, ExactNumbers], key("inputs by name")]
    outputs: Annotated[dict[str, ExactNumbers], key("outputs by name")]
    tolerance: Annotated[list[float], key("allowed error of each output in single precision", "SI")]


class VerifyDocument(Document, frozen=True, kw_only=True):
    """The comparison of generated code with SymPy: `tendon verify --json`."""

    arm: ArmName
    samples: Annotated[int, key("random inputs of each function", "1")]
    seed: Annotated[int, key("seed of the inputs")]
    equal: Annotated[bool, key("whether everything is equal")]
    proofs: Annotated[list[ProofEntry], key("exact comparisons; empty for a planar arm")]
    cases: Annotated[list[ComparedFunction], key("each function on each target")]
    vectors: Annotated[list[TestVector], key("inputs and outputs to replay on other hardware")]


class UsedCompiler(Document, frozen=True, kw_only=True):
    """A compiler."""

    kind: Annotated[str, key("gcc, zig or host")]
    version: Annotated[str, key("what it says of itself")]
    why: Annotated[str, key("why it was chosen")]


class StackEntry(Document, frozen=True, kw_only=True):
    """Stack that the firmware needs."""

    main: Annotated[int, key("deepest chain of calls from the start", "bytes")]
    handlers: Annotated[int, key("deepest exception handler, on top of it", "bytes")]
    chain: Annotated[list[tuple[str, int]], key("functions of the deepest chain, with the bytes of each")]
    unknown: Annotated[list[str], key("why the depth has no known bound; empty if it has one")]
    worst: Annotated[int, key("main and handlers together", "bytes")]


class BuildEntry(Document, frozen=True, kw_only=True):
    """The compiled firmware; on the host a shared library without the keys of an image."""

    target: Annotated[str, key("cortex-m4f, cortex-m7 or host")]
    machine: Annotated[str | UnsetType, key("machine of QEMU that runs it")] = UNSET
    toolchain: Annotated[UsedCompiler, key("compiler that was used")]
    elf: Annotated[str | UnsetType, key("file name of the image with symbols")] = UNSET
    binary: Annotated[str | UnsetType, key("file name of the bare image")] = UNSET
    start: Annotated[int | UnsetType, key("address at which the image is loaded")] = UNSET
    text: Annotated[int | UnsetType, key("code and constants", "bytes")] = UNSET
    data: Annotated[int | UnsetType, key("initialised variables", "bytes")] = UNSET
    bss: Annotated[int | UnsetType, key("variables that start at zero", "bytes")] = UNSET
    stack: Annotated[StackEntry | None, key("stack; null on the host")]
    forbidden: Annotated[
        list[str] | UnsetType, key("functions for double precision, a heap or text that it contains")
    ] = UNSET
    symbols: Annotated[dict[str, int] | UnsetType, key("addresses by symbol")] = UNSET
    outputs: Annotated[list[str], key("paths of the compiled files")]
    stack_size: Annotated[int | UnsetType, key("stack that the linker script reserves", "bytes")] = UNSET
    fits: Annotated[bool, key("whether the stack suffices and nothing forbidden is in it")]


class MonitoredJointEntry(Document, frozen=True, kw_only=True):
    """A joint in the eyes of the monitor on the board."""

    joint: Annotated[int, key("its number, from 1")]
    floor: Annotated[float, key("RMS of its residual while the model holds", "N m or N")]
    load_floor: Annotated[float, key("what that has more for each unit of load", "1")]
    hours: Annotated[float, key("of motion between two false alarms", "h")]


class MonitorEntry(Document, frozen=True, kw_only=True):
    """What the monitor on the board promises."""

    cutoff: Annotated[float, key("of the low-pass on the residual", "Hz")]
    false_alarms: Annotated[float, key("stated, in a thousand hours of motion", "1")]
    joints: Annotated[list[MonitoredJointEntry], key("each joint")]


class MissedEntry(Document, frozen=True, kw_only=True):
    """A joint of which the recordings of --monitor show more than noise beside the model."""

    joint: Annotated[int, key("its number, from 1")]
    unit: Annotated[str, key("of the following two")]
    rms: Annotated[float, key("of the residual with the model file's values")]
    floor: Annotated[float, key("noise of the recordings")]


class FirmwareDocument(Document, frozen=True, kw_only=True):
    """The controller's firmware: `tendon firmware --json`; with --check only name, directory and stale."""

    name: ArmName
    directory: Directory
    target: Annotated[str | UnsetType, key("target for which it was compiled")] = UNSET
    files: Annotated[list[str] | UnsetType, key("generated files")] = UNSET
    kept: Annotated[list[str] | UnsetType, key("files of the user's that were left as they are")] = UNSET
    stale: Annotated[list[str], key("files that --check found out of date")]
    open: Annotated[list[OpenEntry] | UnsetType, key("what the model file leaves open")] = UNSET
    build: Annotated[BuildEntry | UnsetType, key("what was compiled")] = UNSET
    monitor: Annotated[MonitorEntry | UnsetType, key("with [monitor]: of the model on the board")] = UNSET
    missed: Annotated[list[MissedEntry] | UnsetType, key("with --monitor: joints whose model the recordings miss")] = (
        UNSET
    )

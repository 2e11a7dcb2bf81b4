"""Sections of effects, verify, import and export."""

from __future__ import annotations

import shlex
from collections.abc import Sequence

from msgspec.structs import astuple

from runtime.documents.diagnosis import CommandEntry
from runtime.documents.generated import ComparedFunction, FirmwareDocument, GenerateDocument, VerifyDocument
from runtime.documents.models import (
    EffectDocument,
    EffectsDocument,
    ExportDocument,
    ImportDocument,
    ImportedJointEntry,
    InitControllerDocument,
    InitScenarioDocument,
    ProposedEntry,
)
from runtime.documents.parts import given
from runtime.model.loader import Model
from runtime.report.sections import Commands, Paragraph, Section, table, texts, words
from runtime.wording import number, percent, quantity, times_floor
from symbolic.model_file.checks import open_lines

_MOST_NUMBERS = 7
"""Numbers of a vector that a cell of a table has room for."""
_ROUNDING = 1e-9
"""Part of the torque below which a difference is rounding."""


def controller(document: InitControllerDocument) -> list[Section]:
    """What was proposed for a controller, a row a value, and where it was written."""
    if not document.proposed:
        return [Paragraph(f"{document.model}: states everything that its controller needs; nothing to propose")]
    alike: dict[tuple[str, str, str], list[ProposedEntry]] = {}
    for entry in document.proposed:
        alike.setdefault((entry.key, entry.unit, entry.why), []).append(entry)
    rows = [
        (key, ", ".join(str(p.joint or "all") for p in of), ", ".join(number(p.value, 4) for p in of), unit, why)
        for (key, unit, why), of in alike.items()
    ]
    if document.out is None:
        wrote = "Nothing is written: --write puts them into the model file, --out FILE into a copy."
    else:
        wrote = f"Written to {document.out}, each with a comment that says that it is proposed."
    return [
        Paragraph(f"{document.name}: position loops of {document.bandwidth:.2g} Hz ({document.limit})"),
        table(("key", "joint", words("proposed"), "unit", words("why")), rows),
        Paragraph(wrote),
    ]


def begun_scenario(document: InitScenarioDocument) -> list[Section]:
    """The scenario that was written, and what to do with it."""
    where = f"joint{'s' * (len(document.springs) > 1)} {', '.join(map(str, document.springs))}"
    springs = f"a parallel spring at {where}" if document.springs else "no springs"
    said = (
        f"{document.out}: {document.name}, {' to '.join(document.points)} in {number(document.seconds, 4)} s, {springs}"
    )
    plan = shlex.join(["tendon", "optimize", document.out, "--out", "plan.json"])
    return [Paragraph(said), Commands((CommandEntry(command=plan, what="plans motion and springs"),))]


def arm(model: Model, text: str) -> list[Section]:
    """The joints of an arm and what is known of them, and its model file."""
    rows = []
    for i, joint in enumerate(model.joints, 1):
        low, high = joint.position_limits or (None, None)
        limits = [
            "" if low is None or high is None else f"{number(low, 4)} … {number(high, 4)} {joint.position_unit}",
            "" if joint.speed_limit is None else f"{number(joint.speed_limit, 4)} {joint.position_unit}/s",
            "" if joint.torque_limit is None else f"{number(joint.torque_limit, 4)} {joint.force_unit}",
        ]
        values = "; ".join(
            f"{name} {', '.join(f'{key} {number(x, 4)}' for key, x in known.items()) or 'unknown'}"
            for name, known in joint.effects.items()
        )
        who = f"{i} {joint.name or ''}".rstrip()
        rows.append((who, joint.type, number(joint.gear_ratio, 4), *limits, ", ".join(joint.unknown), values))
    heads = ("joint", words("type"), "gear ratio", "range", "speed", "torque", words("unknown"), words("effects"))
    return [table(heads, rows), Paragraph(text, "code")]


def effects(document: EffectsDocument) -> list[Section]:
    """The library of effects, a row an effect."""
    rows = [
        (
            effect.name,
            effect.scope,
            ", ".join(f"{p.name}{' (in space)' if p.space else ''}" for p in effect.parameters),
            effect.summary,
        )
        for effect in document.effects
    ]
    return [table(("effect", "scope", words("parameters"), words("what it is")), rows)]


def effect(document: EffectDocument) -> list[Section]:
    """One effect: its equation, parameters, and how it shows."""
    rows = []
    for p in document.parameters:
        low, high = p.bounds
        bounds = f"{'-∞' if low is None else f'{low:g}'} … {'∞' if high is None else f'{high:g}'}"
        meaning = f"{p.meaning}; of an arm in space only" if p.space else p.meaning
        rows.append((p.name, " or ".join(dict.fromkeys((p.unit.revolute, p.unit.prismatic))), p.role, bounds, meaning))
    facts = {
        "acts on": document.scope,
        "family": document.family,
        "memory": ", ".join(document.states),
        "replaces": ", ".join(document.generalises),
        "trace": document.trace,
        "experiment": document.experiment,
        "source": document.source,
    }
    return [
        Paragraph(f"{document.name}: {document.summary}"),
        Paragraph(document.equation, "code"),
        table(("parameter", "unit", "role", "bounds", words("meaning")), rows),
        *texts(f"{name + ':':12}{text}" for name, text in facts.items() if text),
    ]


def firmware(document: FirmwareDocument) -> list[Section]:
    """What was written and compiled, and its memory; or which files are out of date."""
    return texts(firmware_lines(document))


def firmware_lines(document: FirmwareDocument) -> list[str]:
    """As `firmware`, a line each."""
    build = given(document.build)
    if build is None:
        return document.stale or [f"{document.directory}: up to date"]
    lines = [f"{document.directory}: {len(given(document.files) or ())} files"]
    if document.kept:
        lines.append(f"not generated, left as they are: {', '.join(document.kept)}")
    lines += [
        *open_lines(map(astuple, given(document.open) or ())),
        ", ".join(build.outputs),
        f"compiled for {build.target} by {build.toolchain.version} ({build.toolchain.why})",
    ]
    if (monitor := given(document.monitor)) is not None:
        hours = min(joint.hours for joint in monitor.joints)
        lines.append(
            f"monitor: up to {number(monitor.cutoff)} Hz, floors "
            + ", ".join(f"{number(joint.floor, 3)}" for joint in monitor.joints)
            + f"; {number(hours, 3)} hours of motion between two false alarms of a joint"
        )
    lines += [
        f"warning: joint {joint.joint}: the model file's values leave {quantity(joint.rms, joint.unit)} of the torque, "
        f"{number(times_floor(joint.rms, joint.floor), 2)} times the noise, and the monitor will call that normal; "
        "run tendon identify or diagnose first"
        for joint in given(document.missed) or ()
    ]
    if (stack := build.stack) is None:
        return lines
    chain = " > ".join(f"{name} {size}" for name, size in stack.chain)
    return [
        *lines,
        f"text {build.text:,} B, data {build.data:,} B, bss {build.bss:,} B",
        f"worst stack {stack.worst:,} B of {build.stack_size:,}: {chain}; {stack.handlers} more in a fault handler",
        *(f"the stack has no known bound: {why}" for why in stack.unknown),
        "functions for double precision, a heap or text: " + (", ".join(given(build.forbidden) or ()) or "none"),
    ]


def verification(document: VerifyDocument) -> list[Section]:
    """Whether all are equal; the worst case of each target relative to its tolerance, and every case that is not."""
    cases = document.cases
    worst: dict[str, ComparedFunction] = {}
    for case in cases:
        if case.target not in worst or _ratio(case) > _ratio(worst[case.target]):
            worst[case.target] = case
    wrong = [case for case in cases if not case.equal]
    rows = [
        (
            case.target,
            str(sum(other.target == case.target for other in cases)),
            f"{case.function}: {case.output}",
            "–" if case.ratio is None else percent(case.ratio),
            *("–" if value is None else f"{value:.9g}" for value in (case.expected, case.found)),
            ", ".join(f"{name}={_short(value)}" for name, value in case.inputs.items()),
        )
        for case in [*worst.values(), *(case for case in wrong if case not in worst.values())]
    ]
    heads = ("target", "functions", "worst", "of its tolerance", "SymPy", "target's", words("at"))
    return [*texts(verification_lines(document)), table(heads, rows)]


def verification_lines(document: VerifyDocument) -> list[str]:
    """Whether all are equal, and what was proved."""
    cases, proofs = document.cases, document.proofs
    wrong = sum(not case.equal for case in cases)
    vectors = f"{len(document.vectors)} test vectors with --json"
    points = "1 point" if document.samples == 1 else f"{document.samples} points"
    equal = f"NOT equal: {wrong} of {len(cases)}" if wrong else f"Equal: {len(cases)}"
    answer = f"{equal} comparisons at {points} each; {vectors}."
    differing = [proof for proof in proofs if not proof.equal]
    if proofs and not differing:
        exact = f"exactly, at {proofs[-1].points} random points"
        return [answer, f"Proved: {len(proofs)} functions are the Lagrangian's, {exact}."]
    return [answer, *(f"NOT the Lagrangian's: {proof.function}, {proof.differs}." for proof in differing)]


def _ratio(case: ComparedFunction) -> float:
    return float("inf") if case.ratio is None else case.ratio


def _short(values: Sequence[float]) -> str:
    if len(values) > _MOST_NUMBERS:
        return f"({len(values)} numbers, with --json)"
    return "[" + " ".join(f"{value:.3g}" for value in values) + "]"


def generated(document: GenerateDocument) -> list[Section]:
    """What was written where, and the operations of the inverse dynamics."""
    return texts(generated_lines(document))


def generated_lines(document: GenerateDocument) -> list[str]:
    """The same as lines."""
    count, name = document.operations["inverse_dynamics"], document.name
    rust = f"{name}.rs" if f"{name}.rs" in document.files else "generate --rust"
    return [
        f"{document.directory}: {len(document.files)} files; effects in {document.effects_directory}",
        "inverse dynamics: " + ", ".join(f"{value} {kind}" for kind, value in count.items() if value),
        *open_lines(map(astuple, document.open)),
        f"C++: tendon_{name}.hpp, by CMake find_package(tendon_{name}); Python: pip install "
        f"{_as_folder(document.directory)}; Rust: {rust}",
    ]


def _as_folder(directory: str) -> str:
    return shlex.quote(directory if "/" in directory else f"./{directory}")


def imported(document: ImportDocument) -> list[Section]:
    """The joints of the new arm, notes about it, and what to type next."""
    model = shlex.quote(document.out)
    follow = {
        f"tendon inspect RECORDING {model}": "shows what is in one and what looks wrong with it",
        f"tendon improve {model} RECORDING --held-out ANOTHER": "finds the unknown values and what the model lacks",
    }
    return [
        *imported_arm(document),
        *texts([*document.notes, "", "Next, with recordings of the arm:"]),
        Commands(tuple(CommandEntry(command=command, what=what) for command, what in follow.items())),
    ]


def imported_arm(document: ImportDocument) -> list[Section]:
    """The joints of the new arm, and what of each is unknown."""
    joints = document.joints
    count = "1 joint" if len(joints) == 1 else f"{len(joints)} joints"
    rows = [
        (
            str(joint.joint),
            joint.name or "",
            joint.type,
            "" if joint.mass is None else number(joint.mass),
            _range(joint),
            ", ".join([*joint.unknown, *(name for name, values in joint.effects.items() if not values)]),
        )
        for joint in joints
    ]
    return [
        Paragraph(f"{document.out}: {document.name}, {count} from {document.base} to {document.tip}"),
        table(("joint", "name", "type", "mass [kg]", "range", words("unknown")), rows),
    ]


def _range(joint: ImportedJointEntry) -> str:
    position = joint.limits.position
    unit = "rad" if joint.type == "revolute" else "m"
    return "" if position is None else f"{number(position[0])} to {number(position[1])} {unit}"


def exported(document: ExportDocument) -> list[Section]:
    """The bodies of the written arm, how well they stand for the model, and what the file cannot say."""
    rows = [
        (
            str(joint.joint),
            joint.name,
            number(joint.mass),
            ", ".join(number(value, 3) for value in joint.com),
            *(number(value) for value in (joint.rotor_inertia or None, joint.damping, joint.friction)),
        )
        for joint in document.joints
    ]
    bodies = table(("joint", "name", "mass [kg]", "centre [m]", "rotor", "damping", "friction"), rows)
    return [Paragraph(f"{document.out}: {document.name}"), bodies, *texts(export_notes(document))]


def export_notes(document: ExportDocument) -> list[str]:
    """What the written file does not hold of the model."""
    notes = []
    if document.missing > _ROUNDING:
        notes.append(
            "No physically possible bodies have the model's base parameters: the exported ones miss "
            f"{100 * document.missing:.2g} % of its torques."
        )
    if document.unsaid:
        notes.append(f"The file does not say, or not exactly: {'; '.join(document.unsaid)}.")
    if document.kept:
        notes.append(f"The file into which it was written keeps its own: {'; '.join(document.kept)}.")
    return notes

"""Progress, and what effects, verify, import and export print on the terminal."""

from __future__ import annotations

import shlex
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from rich.console import Console

from runtime.documents.generated import ComparedFunction, VerifyDocument
from runtime.documents.models import (
    EffectDocument,
    EffectsDocument,
    ExportDocument,
    ImportDocument,
    ImportedJointEntry,
)
from runtime.progress import Progress, heard_by
from runtime.report.terminal.cells import (
    COMMAND,
    empty_table,
    figure,
    percent,
    say,
    show_table,
)

_PATIENCE = 2.0  # s
_A_JOINT_EACH = 7  # numbers of a vector that a table has room for
_EVERY = 10.0  # s
_ROUNDING = 1e-9
"""Part of the torque that rounding may miss."""


@contextmanager
def working(what: str) -> Iterator[Callable[[str], None]]:
    """Says on standard error what is going on: a spinner on a terminal, with how far it is and how long that will
    take, else one line after two seconds.

    Gives a function for lines of progress in between.
    """
    console = Console(stderr=True, markup=False, highlight=False, soft_wrap=True)
    if console.is_terminal:
        with console.status(f"{what} …") as status, heard_by(lambda p: status.update(f"{what} … {_how_far(p)}")):
            yield console.print
        return
    timer = threading.Timer(_PATIENCE, lambda: print(f"{what} …", file=sys.stderr, flush=True))
    timer.daemon = True
    timer.start()
    try:
        with heard_by(_Lines(what)):
            yield lambda line: print(line, file=sys.stderr, flush=True)
    finally:
        timer.cancel()


class _Lines:
    """Progress where no line can be written over: a line now and then, of what takes long."""

    def __init__(self, what: str) -> None:
        self.what, self.last = what, time.monotonic()

    def __call__(self, progress: Progress) -> None:
        if time.monotonic() - self.last >= _EVERY and progress.left >= 1:
            self.last = time.monotonic()
            print(f"{self.what} … {_how_far(progress)}", file=sys.stderr, flush=True)


def _how_far(progress: Progress) -> str:
    """The part of a piece of work that is done, and the time that is left of it."""
    share = min(progress.done / progress.parts, 1.0)
    done = f"{progress.what} {progress.done} of {progress.parts} ({share:.0%})"
    return f"{done}, {progress.left:.0f} s left" if progress.left >= 1 else done


def effects(document: EffectsDocument) -> None:
    """The library, one line an effect."""
    table = empty_table("effect", "scope", "parameters", "what it is")
    for effect in document.effects:
        parameters = ", ".join(f"{p.name}{' (in space)' if p.space else ''}" for p in effect.parameters)
        table.add_row(effect.name, effect.scope, parameters, effect.summary)
    show_table(table)


def effect(document: EffectDocument) -> None:
    """One effect's page."""
    say(f"{document.name}: {document.summary}", f"  {document.equation}", "")
    table = empty_table("parameter", "unit", "role", "bounds", "meaning")
    for p in document.parameters:
        units = dict.fromkeys((p.unit.revolute, p.unit.prismatic))
        low, high = p.bounds
        bounds = f"{'-∞' if low is None else f'{low:g}'} … {'∞' if high is None else f'{high:g}'}"
        meaning = f"{p.meaning}; of an arm in space only" if p.space else p.meaning
        table.add_row(p.name, " or ".join(units), p.role, bounds, meaning)
    show_table(table)
    facts = {
        "acts on": document.scope,
        "family": document.family,
        "memory": ", ".join(document.states),
        "replaces": ", ".join(document.generalises),
        "trace": document.trace,
        "experiment": document.experiment,
        "source": document.source,
    }
    say(*(f"{name + ':':12}{text}" for name, text in facts.items() if text))


def verify(document: VerifyDocument) -> None:
    """The worst case of each target, as a part of its tolerance, and every case that is not equal."""
    cases = document.cases
    worst: dict[str, ComparedFunction] = {}
    for case in cases:
        if case.target not in worst or _ratio(case) > _ratio(worst[case.target]):
            worst[case.target] = case
    wrong = [case for case in cases if not case.equal]
    table = empty_table("target", "functions", "worst", "of its tolerance", "SymPy", "target's", "at")
    for case in [*worst.values(), *(case for case in wrong if case not in worst.values())]:
        at = ", ".join(f"{name}={_short(value)}" for name, value in case.inputs.items())
        count = sum(other.target == case.target for other in cases)
        table.add_row(
            case.target,
            str(count),
            f"{case.function}: {case.output}",
            percent(case.ratio),
            _digits(case.expected),
            _digits(case.found),
            at,
        )
    show_table(table)
    proofs = document.proofs
    for proof in proofs:
        if not proof.equal:
            say(f"NOT the Lagrangian's: {proof.function}, {proof.differs}.")
    if proofs and all(proof.equal for proof in proofs):
        say(f"Proved: {len(proofs)} functions are the Lagrangian's, exactly, at {proofs[-1].points} random points.")
    vectors = f"{len(document.vectors)} test vectors with --json"
    if wrong:
        say(f"NOT equal: {len(wrong)} of {len(cases)} comparisons; {vectors}.")
    else:
        say(f"Equal: {len(cases)} comparisons at {document.samples} points each; {vectors}.")


def _ratio(case: ComparedFunction) -> float:
    return float("inf") if case.ratio is None else case.ratio


def _digits(value: float | None) -> str:
    return "–" if value is None else f"{value:.9g}"


def _short(values: Sequence[float]) -> str:
    if len(values) > _A_JOINT_EACH:
        return f"({len(values)} numbers, with --json)"
    return "[" + " ".join(f"{value:.3g}" for value in values) + "]"


def imported(document: ImportDocument) -> None:
    """The joints of the new arm, and what a person should know of it."""
    joints = document.joints
    count = "1 joint" if len(joints) == 1 else f"{len(joints)} joints"
    say(f"{document.out}: {document.name}, {count} from {document.base} to {document.tip}")
    table = empty_table("joint", "name", "type", "mass [kg]", "range", "unknown")
    for joint in joints:
        effects = [name for name, values in joint.effects.items() if not values]
        mass = "" if joint.mass is None else f"{joint.mass:.4g}"
        unknown = ", ".join([*joint.unknown, *effects])
        table.add_row(str(joint.joint), joint.name or "", joint.type, mass, _range(joint), unknown)
    show_table(table)
    say(*document.notes)
    model = shlex.quote(document.out)
    say(
        "",
        "Next, with recordings of the arm:",
        f"  {COMMAND}inspect RECORDING {model}",
        "      shows what is in one and what looks wrong with it",
        f"  {COMMAND}improve {model} RECORDING --held-out ANOTHER",
        "      finds the unknown values and what the model lacks",
    )


def _range(joint: ImportedJointEntry) -> str:
    unit = "rad" if joint.type == "revolute" else "m"
    position = joint.limits.position
    return "" if position is None else f"{position[0]:.4g} to {position[1]:.4g} {unit}"


def exported(document: ExportDocument) -> None:
    """The bodies of the written arm, how well they stand for the model, and what the file cannot say."""
    say(f"{document.out}: {document.name}")
    table = empty_table("joint", "name", "mass [kg]", "centre [m]", "rotor", "damping", "friction")
    for joint in document.joints:
        com = ", ".join(f"{value:.3g}" for value in joint.com)
        friction = map(figure, (joint.damping, joint.friction))
        rotor = figure(joint.rotor_inertia or None)
        table.add_row(str(joint.joint), joint.name, f"{joint.mass:.4g}", com, rotor, *friction)
    show_table(table)
    if document.missing > _ROUNDING:
        say(
            "No physically possible bodies have the model's base parameters: the exported ones miss "
            f"{100 * document.missing:.2g} % of its torques."
        )
    if document.unsaid:
        say(f"The file does not say: {'; '.join(document.unsaid)}.")
    if document.kept:
        say(f"The file into which it was written keeps its own: {'; '.join(document.kept)}.")

"""One row of the judge's table: a case made, diagnosed and judged; and the table as a file."""

from __future__ import annotations

import csv
import functools
import hashlib
import json
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from runtime.diagnosis.stages import diagnose
from runtime.diagnosis.verdict import Diagnosis
from runtime.experiments import asking, design
from runtime.identification.drive_gains import with_gains
from runtime.identification.identify import fit_document
from runtime.recordings import recording
from runtime.recordings.columns import RecordedArm
from runtime.recordings.recording import Recording
from runtime.report.diagnosed import document as diagnosed
from runtime.simulation.simulate import SimulationError
from runtime.workspace.source import Source

from . import cases as judging
from . import coverage, limits, others, scoring
from .bodies import BELIEVED
from .cases import Case, Made
from .held_out import error_and_floor
from .recorder import Logger
from .scoring import tag

ROOT = Path(__file__).resolve().parents[2]
_NONE = float("nan")


@dataclass
class Line:
    """One row. wanted: the size asked for; column: of the confusion matrix; among: the truth is among findings and
    rivals; exact: what is hidden was named, and nothing else; other_form: one is said to have another form; lines: of a
    ripple, those found of those hidden; inside, of: true parameters in their intervals, of how many; covered: all
    intervals whose true value is known, see coverage.py; ratio: error over floor on the recording that was not fitted;
    drive: form of drives.py; gains: of the drives, identified over true;
    pysindy, sysidentpy: what they named, and whether it was right; code: digest of what was judged;
    said: of the remainders."""

    case: str
    kind: str
    joints: int
    seed: int
    setting: str
    wanted: float
    truth: str = ""
    size: str = ""
    beyond_delay: float = _NONE
    outcome: str = ""
    extra: int = 0
    among: bool = False
    exact: bool = False
    column: str = ""
    verdict: str = ""
    named: str = ""
    rivals: str = ""
    remainder: bool = False
    other_form: bool = False
    lines: str = ""
    before: float = _NONE
    after: float = _NONE
    floor: float = _NONE
    held_out_after: float = _NONE
    ratio: float = _NONE
    drive: str = ""
    gains: str = ""
    inside: int = 0
    of: int = 0
    covered: str = ""
    cutoff: float = _NONE
    seconds: float = _NONE
    amount: str = ""
    parameters: str = ""
    pysindy: str = ""
    pysindy_named: str = ""
    pysindy_seconds: float = _NONE
    sysidentpy: str = ""
    sysidentpy_named: str = ""
    sysidentpy_seconds: float = _NONE
    code: str = ""
    said: str = ""
    reason: str = ""

    @property
    def key(self) -> tuple[str, int, int, str, float]:
        return self.case, self.joints, self.seed, self.setting, self.wanted

    @property
    def sizes(self) -> list[float]:
        return [float(x) for x in self.size.split()]


def blank(case: Case) -> Line:
    """The row of a case before it is made."""
    setting = case.setting
    return Line(
        case.label, case.kind, setting.joints, case.seed, str(setting), case.size, drive=setting.drive, code=code()
    )


def line(case: Case, held_out: bool = False, compared: bool = False, experiments: bool = False) -> Line:
    """Makes a case, diagnoses it, judges the answer. An exception is an outcome, "failed".

    held_out     the diagnosis sees the second recording
    compared     pysindy and sysidentpy answer, too
    experiments  a rival counts as right where the motion that `tendon experiment` proposes separates it from the truth
    """
    out = blank(case)
    try:
        made = _at_its_limit(case) if case.kind == "limits" else judging.make(case)
        if made is None:
            out.outcome = "no limit"
            return out
        truth = [tag(h.truth or name, j) for h, name, j in zip(made.hidden, case.names, made.joints, strict=True)]
        out.truth = " ".join(truth)
        out.size = " ".join(f"{x:.2f}" for x in made.sizes)
        out.beyond_delay = made.beyond_delay
        out.amount = " ".join(f"{x:.4g}" for x in made.amounts)
        made = logged(made)
        out.gains = _gains(made)
        compiled = opened(made.model).compiled
        model = compiled.model()
        start = time.process_time()
        found = diagnose(model, [made.recording], [made.held_out] if held_out else [])
        answer = diagnosed(found).to_json()
        out.seconds = time.process_time() - start
        _judge(out, made, found, answer, experiments)
        if compared and _comparable(made):
            _compare(out, made)
    except Exception as error:
        out.outcome, out.reason = "failed", f"{type(error).__name__}: {error}"
        traceback.print_exc(file=sys.stderr)
    return out


def opened(text: str) -> Source:
    with tempfile.TemporaryDirectory() as directory:
        path = Path(directory) / "model.toml"
        path.write_text(text, encoding="utf-8")
        return Source.read(path, None)


def logged(made: Made) -> Made:
    """The case with recordings that went through a file, as a user's do: without torques where drives are told what to
    make, with the gains that are identified."""
    source = opened(made.model) if made.case.setting.drive else None
    arm = source.recorded_arm() if source else RecordedArm.without_model(made.case.setting.joints)
    with tempfile.TemporaryDirectory() as directory:
        path, found = Path(directory) / "judge.csv", list[Recording]()
        for recorded in (made.recording, made.held_out):
            recorded.save(path)
            found.append(replace(recording.read(path, arm), path=recorded.path))
    if source:
        found = with_gains(source.compiled.model(), found, 1)
    return replace(made, recording=found[0], held_out=found[1])


def _gains(made: Made) -> str:
    """Identified gains over the true ones, joint by joint."""
    words = []
    for number, (driven, motor) in enumerate(zip(made.recording.driven, made.motors, strict=False), 1):
        true = motor.gains
        told = {} if driven is None else {k: x.value for k, x in driven.told.items() if k in true and not x.imitated}
        words += [f"{name}{number} {value / true[name]:.3f}" for name, value in told.items()]
    return ", ".join(words)


def _at_its_limit(case: Case) -> Made | None:
    """The case with its effect a little beyond what the same recording without it would have seen; None: no limit."""
    clean = judging.make(replace(case, names=()))
    seen = diagnosed(diagnose(opened(clean.model).compiled.model(), [clean.recording])).to_json()["would_have_seen"]
    amount = limits.beyond(seen, case.names[0], judging.places(case)[0])
    return None if amount is None else judging.make(case, [amount])


def _separates(made: Made) -> scoring.Separates:
    return lambda a, b: _separated(made.model, min(a, b), max(a, b))


@functools.cache
def _separated(text: str, a: str, b: str) -> bool:
    """Whether the experiment that is proposed for a model tells two effects apart in simulation."""
    model = opened(text).compiled.model()
    try:
        return design.propose(model, asking.parse_rivals(f"{a},{b}", model)).separated
    except (asking.ExperimentError, SimulationError):
        return False


def _judge(out: Line, made: Made, found: Diagnosis, answer: dict[str, Any], experiments: bool) -> None:
    """The diagnosis's answer into the row."""
    findings = answer["findings"]
    score = scoring.judged(made, findings, answer["verdict"], _separates(made) if experiments else None)
    out.outcome, out.extra, out.among = score.outcome, score.extra, score.among
    out.column = scoring.column(made, findings, answer["verdict"])
    out.verdict, out.reason, out.cutoff = answer["verdict"], answer["reason"], answer["band"]["cutoff_hz"]
    out.named = " ".join(tag(f["effect"], f["joint"]) for f in findings)
    out.rivals = " ".join(tag(r["effect"], r["joint"]) for r in findings[0]["rivals"]) if findings else ""
    out.exact = scoring.exact(score, answer["verdict"], made)
    out.said = " | ".join(f["remainder"] for f in findings if f["remainder"])
    out.remainder, out.other_form = bool(out.said), "another form" in out.said
    out.lines = scoring.lines(made, findings)
    at = next((j - 1 for j in made.joints if j), 0)
    out.before, out.floor = answer["joints"][at]["rms"], answer["joints"][at]["floor"]
    here = [f for f in findings if (f["joint"] or at + 1) == at + 1]
    out.after = here[-1]["rms_after"] if here else out.before
    error, floor = error_and_floor(made, found)
    out.held_out_after, out.ratio = float(error[at]), float(np.max(error / floor))
    if out.kind == "unknown" and out.outcome == "wrong" and out.after < scoring.MIMIC * out.floor:
        out.outcome, out.extra = "mimic", 0
    out.parameters = json.dumps([{k: v["value"] for k, v in f["parameters"].items()} for f in findings])
    if made.knows and (out.exact or (made.parameters is not None and not findings)):
        held = _covered(made, found)
        out.covered = coverage.to_text(held)
        if made.parameters is not None:
            out.inside, out.of, together = scoring.agreement([(c.low, c.high) for c in held], [c.true for c in held])
            if out.outcome == "right" and not together:
                out.outcome = "off"


def _covered(made: Made, found: Diagnosis) -> list[coverage.Covered]:
    fit = found.steps[-1].fit
    lumps = coverage.true_lumps(made, fit.model.regressor)
    return coverage.covered(made, fit_document(fit).to_json(), lumps)


def _comparable(made: Made) -> bool:
    """Whether the other tools can be given the recording: at the drives' period, by a model file with the gravity."""
    return (
        made.knows and made.case.setting.logger == Logger() and made.gravity == made.case.setting.gravity == (0.0, 0.0)
    )


def _compare(out: Line, made: Made) -> None:
    """What pysindy and sysidentpy say of the same recording, judged as the diagnosis is."""
    believed = next((h.believed for h in made.hidden if h.believed != BELIEVED), BELIEVED)
    for method, choose in others.METHODS.items():
        answer = others.answer(made, believed, out.cutoff, choose)
        findings = [_finding(name) for name in answer.named]
        outcome = scoring.judged(made, findings, "effect" if findings else "clean").outcome
        setattr(out, method, outcome)
        setattr(out, f"{method}_named", " ".join(answer.named))
        setattr(out, f"{method}_seconds", answer.seconds)


def _finding(name: str) -> dict[str, Any]:
    effect, _, joint = name.partition("@")
    return {"effect": effect, "joint": int(joint) if joint else None, "rivals": []}


@functools.cache
def code() -> str:
    """Digest of the sources that are judged."""
    digest = hashlib.sha256()
    for folder in ("symbolic", "codegen", "runtime"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            digest.update(path.read_bytes())
    return digest.hexdigest()[:10]


def write(path: Path, lines: Sequence[Line]) -> None:
    """The table anew."""
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, [f.name for f in fields(Line)])
        table.writeheader()
        table.writerows(asdict(x) for x in lines)


def append(path: Path, row: Line) -> None:
    with path.open("a", newline="", encoding="utf-8") as file:
        csv.DictWriter(file, [f.name for f in fields(Line)]).writerow(asdict(row))


def read(path: Path) -> list[Line]:
    """A table as written. ValueError if it has other columns."""
    with path.open(newline="", encoding="utf-8") as file:
        table = csv.DictReader(file)
        if table.fieldnames != [f.name for f in fields(Line)]:
            raise ValueError(f"{path}: not a table of this judge's; write to another file")
        return list(_read(table))


def _read(table: csv.DictReader[str]) -> Iterator[Line]:
    kinds: dict[str, Callable[[str], Any]] = {"int": int, "float": float, "bool": lambda x: x == "True", "str": str}
    for row in table:
        yield Line(**{f.name: kinds[str(f.type)](row[f.name]) for f in fields(Line)})

"""What the terminal says, from made-up documents of the kind that --json writes."""

from __future__ import annotations

import ast
import io
import re
from pathlib import Path
from typing import Annotated, Any, Literal, cast, get_args, get_origin

import msgspec
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from rich.console import Console

from runtime.diagnosis.candidates import Candidate
from runtime.diagnosis.detection_limits import Limit
from runtime.diagnosis.gates import FALL, PART, SCORE, TORQUE
from runtime.documents.diagnosis import (
    DiagnosedJoint,
    DiagnosisDocument,
    EvidenceEntry,
    FindingEntry,
    FloorEntry,
    HistoryEntry,
    ImprovementDocument,
    LimitEntry,
    RankedCandidate,
)
from runtime.documents.fits import (
    ComparedJoint,
    CompareDocument,
    FittedEffect,
    FittedParameter,
    InertialEntry,
    JointEntry,
    JudgedFitDocument,
)
from runtime.documents.generated import ComparedFunction, VerifyDocument
from runtime.documents.parts import DelayEntry, EffectAt, EstimateEntry
from runtime.documents.recordings import ClockEntry, DeterminedParameter, InspectDocument
from runtime.model.loader import Model
from runtime.model.terms import Term
from runtime.report import findings, fits, loop, models, recordings, terminal
from runtime.report.reasons import closed_gates
from runtime.report.sections import table, words
from runtime.wording import fixed, told_apart


def made(kind: Any, **values: Any) -> Any:
    """A document of a kind; keys that are not given have some value of their type, or are absent where they may be."""
    fields = {f.name: f for f in msgspec.structs.fields(kind)}
    some = {name: _some(f.type) for name, f in fields.items() if f.required and name not in values}
    return kind(**some, **values)


def _some(kind: Any) -> Any:
    if get_origin(kind) is Annotated:
        return _some(get_args(kind)[0])
    if type(None) in get_args(kind):
        return None
    if get_origin(kind) is Literal:
        return get_args(kind)[0]
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        return made(kind)
    return (get_origin(kind) or kind)()


def test_only_the_terminal_prints() -> None:
    """Verbs print through `terminal.show` and `say`, which break no word; messages go to standard error."""
    own = Path(terminal.__file__)
    modules = [path for path in own.parents[1].rglob("*.py") if path != own]
    assert len(modules) > 100
    assert [path.name for path in modules if any(map(prints, ast.walk(ast.parse(path.read_text("utf-8")))))] == []


def prints(node: ast.AST) -> bool:
    """Whether a call prints on standard output."""
    if not isinstance(node, ast.Call):
        return False
    if isinstance(node.func, ast.Attribute):
        return node.func.attr == "print"
    return (
        isinstance(node.func, ast.Name) and node.func.id == "print" and not any(k.arg == "file" for k in node.keywords)
    )


def delay(joint: int, value: float) -> DelayEntry:
    return made(DelayEntry, joint=joint, value=value, assumed=value)


@pytest.mark.parametrize(
    ("values", "places"),
    [
        ([5e-4], ["joint 1: 0.5 ms"]),
        ([5e-4, 5e-4, 5e-4], ["every joint: 0.5 ms"]),
        ([5e-4, 2e-3, 5e-4], ["joints 1, 3: 0.5 ms", "joint 2: 2 ms"]),
    ],
)
def test_joints_of_one_delay_share_a_line(
    values: list[float], places: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    terminal.show(fits.delays([delay(i, value) for i, value in enumerate(values, 1)]))
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(" (")[0] for line in lines] == [f"Delay from torque to motion, {where}" for where in places]


@given(
    st.lists(st.lists(st.text("abcdefgh ", max_size=30), min_size=3, max_size=3), min_size=1, max_size=5),
    st.integers(20, 90),
)
@example([["", " aaaaaaa", ""]], 23)
def test_no_word_is_broken_however_narrow_the_terminal(rows: list[list[str]], width: int) -> None:
    """Every word stands whole, and no line is longer than the terminal, or than a word that is."""
    screen = io.StringIO()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(terminal, "_console", lambda: Console(file=screen, width=width, markup=False, highlight=False))
        patch.setattr("sys.stdout", type("Terminal", (), {"isatty": lambda _: True})())
        terminal.show([table(("first", "second heading", words("third")), rows)])
        terminal.say(" ".join(rows[0]))
    given = {word for row in rows for cell in row for word in cell.split()}
    said = screen.getvalue()
    known = given | {"first", "first:", "second", "heading", "heading:", "third", "third:"}
    assert {word for word in said.split() if "─" not in word} <= known
    assert given <= set(said.split())
    longest = max(map(len, known))
    assert all(len(line.rstrip()) <= max(width, longest + 6) for line in said.splitlines())


@pytest.mark.parametrize(
    ("value", "other", "said"),
    [(0.1499, 0.15, "0.1499"), (0.12, 0.15, "0.12"), (1.0043, 1.0, "1.004"), (0.9996, 1.0, "0.9996"), (1.0, 1.0, "1")],
)
def test_a_number_is_told_from_the_limit_beside_it(value: float, other: float, said: str) -> None:
    assert told_apart(value, other) == said


@pytest.mark.parametrize(("value", "said"), [(-0.0004, "0.000"), (-0.0006, "-0.001"), (1.5, "1.500")])
def test_what_rounds_to_zero_has_no_sign(value: float, said: str) -> None:
    assert fixed(value) == said


def test_what_is_known_of_an_effect_at_many_joints_is_said_once(capsys: pytest.CaptureFixture[str]) -> None:
    known = [
        "ZZ1",
        "I2",
        *(f"dry@{k} {sign}" for k in (1, 2) for sign in ("up", "down")),
        "dry@3 up",
        "plate stiffness",
    ]
    parameters = [made(DeterminedParameter, name=name, told="well") for name in known]
    terminal.show(recordings.inspection(made(InspectDocument, clock=made(ClockEntry), parameters=parameters)))
    told = "ZZ1, I2; dry (up, down) at joints 1, 2; dry (up) at joint 3; plate (stiffness)"
    assert f"\nWell determined: {told}\n" in capsys.readouterr().out


def test_long_inputs_of_a_comparison_are_counted(capsys: pytest.CaptureFixture[str]) -> None:
    case = made(ComparedFunction, equal=True, inputs={"parameters": [0.5] * 43, "q": [1.0, 2.0]})
    terminal.show(models.verification(made(VerifyDocument, cases=[case])))
    assert "parameters=(43 numbers, with --json), q=[1 2]" in " ".join(capsys.readouterr().out.split())


@given(
    near=st.floats(1e-12, 1e-2).flatmap(lambda x: st.sampled_from([x, -x])), side=st.sampled_from(["above", "below"])
)
def test_a_limit_never_reads_as_what_changes_nothing(
    drive: Model, near: float, side: Literal["above", "below"]
) -> None:
    """A factor of 1 is no effect: "factor more than 1" would be any."""
    limit = Limit(Term("torque_scale", 1), "factor", side, 1 + near, "1", 0, 1.0)
    words = findings.limit_words(limit, drive)
    assert float(words.split()[-1]) != 1.0
    assert (float(words.split()[-1]) > 1) == (near > 0)


@given(below=st.floats(1e-9, 0.5), price=st.sampled_from([10.0, 12.83, 27.5]))
def test_no_reason_says_that_a_number_is_not_itself(below: float, price: float) -> None:
    """Whatever is left out by a hair: "0.15 of the noise floor, not 0.15" tells nobody why."""
    limits = {SCORE: price, **{gate: gate.limit for gate in (TORQUE, PART, FALL)}}
    results = tuple(gate.asked((1 - below) * limit, limit) for gate, limit in limits.items())
    sentences = closed_gates(Candidate(Term("cable", 1), {}, 0, 1.0, 1.0, results=results), cast(Model, None))
    assert len(sentences) == len(limits)
    for said in sentences:
        value, limit = re.findall(r"[-−]?\d+(?:\.\d+)?", said)
        assert float(value.replace("−", "-")) < float(limit)


def test_what_is_noise_is_not_said_to_come_back(capsys: pytest.CaptureFixture[str]) -> None:
    joint = {"joint": 1, "relative": 0.01, "floor": 0.1, "floor_source": "repeats", "repeatable": True}
    joints = [made(ComparedJoint, **joint, rms=rms, structure=[]) for rms in (0.102, 0.3)]
    terminal.show(loop.sections(made(CompareDocument, joints=joints)))
    assert [line.split()[-1] for line in capsys.readouterr().out.splitlines() if "repeats" in line] == ["noise", "yes"]


def weighed(effect: str, gain: float, failed: list[str], **values: float) -> RankedCandidate:
    evidence = made(EvidenceEntry, eff=0.3, gain=gain, score=gain, failed_gates=failed, **values)
    return RankedCandidate(effect=effect, joint=1, evidence=evidence)


def diagnosed(**values: Any) -> DiagnosisDocument:
    joint = made(DiagnosedJoint, joint=1, name="elbow", unit="N m", floor=0.1)
    return made(DiagnosisDocument, joints=[joint], **values)


def test_what_was_not_chosen_is_said_with_the_reason(capsys: pytest.CaptureFixture[str]) -> None:
    """Many effects gain much by themselves: the gain alone reads as a contradiction."""
    ranking = [
        weighed("stribeck", 900.0, []),
        weighed("viscous_power", 720.0, []),
        weighed("friction_patch", 950.0, []),
        weighed("lugre", 100.0, ["its score of 4 does not reach the price of 13", "another"]),
        weighed("offset", 1.0, []),
    ]
    rivals = [EffectAt(effect="cable", joint=1)]
    evidence = ranking[0].evidence
    finding = made(FindingEntry, effect="stribeck", joint=1, evidence=evidence, ranking=ranking, rivals=rivals)
    terminal.show(loop.sections(diagnosed(findings=[finding])))
    out = capsys.readouterr().out
    assert "these data cannot separate it from cable at joint 1 (elbow)" in out
    assert [line for line in out.splitlines() if "ruled out" in line] == [
        "  viscous_power at joint 1 (elbow) is ruled out: it passes every gate by itself, but gains 180 less than "
        "stribeck at joint 1 (elbow)",
        "  friction_patch at joint 1 (elbow) is ruled out: it passes every gate by itself, but with it added and "
        "everything refitted, the error falls less than with stribeck",
        "  lugre at joint 1 (elbow) is ruled out: its score of 4 does not reach the price of 13; another",
    ]


def test_the_score_is_said_with_its_price(capsys: pytest.CaptureFixture[str]) -> None:
    evidence = made(EvidenceEntry, eff=0.1, gain=812.4, dispersion=2.5, score=325.0, price=12.83)
    finding = made(FindingEntry, effect="elasticity", joint=1, evidence=evidence)
    terminal.show(loop.sections(diagnosed(findings=[finding])))
    said = "gain of the log-likelihood 812; dispersion 2.5; score 325, for a price of 13"
    assert said in " ".join(capsys.readouterr().out.split())


def test_a_candidate_that_gains_nothing_is_said_so(capsys: pytest.CaptureFixture[str]) -> None:
    failed = ["its score of −2.2 does not reach the price of 10", "its own torque is 0.1 of the noise floor, not more"]
    terminal.show(loop.sections(diagnosed(verdict="unexplained", ruled_out=[weighed("cable", -2.2, failed)])))
    assert "  cable at joint 1 (elbow) is ruled out: the likelihood gains nothing with it\n" in capsys.readouterr().out


@pytest.mark.parametrize("columns", [80, 140])
def test_parameters_of_a_long_arm_fit_a_narrow_screen(
    columns: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """No number and no heading is broken."""
    monkeypatch.setattr(terminal.sys.stdout, "isatty", lambda: True)
    monkeypatch.setenv("COLUMNS", str(columns))
    known = {"interval": (-0.0007479, 0.001908), "unit": "kg m^2", "model": -0.0002842}
    positive = FittedParameter(value=1.2345, **known)
    effect = made(FittedEffect, name="coulomb_asymmetric", joint=6, parameters={"positive": positive})
    inertial = InertialEntry(joint=6, name="YY6", fit=-0.0001335, **known)
    joints = [made(JointEntry, joint=6, name="shoulder_lift_joint")]
    terminal.show(fits.identification(made(JudgedFitDocument, inertial=[inertial], effects=[effect], joints=joints)))
    out = re.sub(r"\x1b\[[0-9;]*m", "", capsys.readouterr().out).split("residual")[0]
    out = out[out.index("parameter") :]
    assert max(map(len, out.splitlines())) <= columns
    assert len(out.splitlines()) < 12
    for whole in ("parameter", "shoulder_lift_joint", "-0.0001 ±", "1.2345 ±", "kg"):
        assert whole in out


@pytest.mark.parametrize("known", [None, [0.5, 2.0]])
@pytest.mark.parametrize("others", [[], ["offset"]])
def test_what_is_said_behind_a_value_stands_off_from_its_unit(known: list[float] | None, others: list[str]) -> None:
    parameter = made(EstimateEntry, value=1.0, unit="N m", interval=known, inseparable_from=others)
    text = findings.valued("torque", parameter)
    assert text == "torque = 1 N m" + (", 95 % in [0.5, 2]" if known else "") + (
        ", only together with offset" if others else ""
    )


def long_arm(n: int) -> ImprovementDocument:
    """What a loop has found on an arm of n joints: a first model and one addition, fitted and held out."""
    of_each = [{"joint": i, "floor": 0.1 * i, "floor_source": "repeats"} for i in range(1, n + 1)]
    joints = [made(DiagnosedJoint, **x, name=f"axis{x['joint']}", unit="N m", verdict="clean") for x in of_each]
    history = []
    for added, size in ((None, 0.5), ("stribeck@2", 0.25)):
        rms = [size * i for i in range(1, n + 1)]
        relative = [x / 100 for x in rms]
        history.append(HistoryEntry(added=added, rms=rms, relative=relative, held_out=rms, held_out_relative=relative))
    limit = {"effect": "cable", "parameter": "c1", "unit": "N m/rad", "assumed": {"c2": 0.5}}
    return made(
        ImprovementDocument,
        verdict="clean",
        joints=joints,
        held_out_floors=[FloorEntry(**entry) for entry in of_each],
        history=history,
        would_have_seen=[LimitEntry(**limit, joint=i, above=1.5 * i) for i in range(1, n)],
    )


def test_many_joints_have_a_line_each(capsys: pytest.CaptureFixture[str]) -> None:
    terminal.show(loop.sections(long_arm(7)))
    lines = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    assert [x for x in lines if x.startswith("7 axis7")] == ["7 axis7 3.50 %, 3.5 1.75 %, 1.75 0.7 (repeats)"] * 2
    assert [x.partition("]")[0] for x in lines if "noise floor" in x] == ["error, rms [N m", "held out, rms [N m"]
    assert "cable: c1 >, N m/rad 1.5 3 4.5 6 7.5 9" in lines


def test_few_joints_have_their_detection_limits_abreast(capsys: pytest.CaptureFixture[str]) -> None:
    terminal.show(loop.sections(long_arm(2)))
    said = re.sub(" +", " ", capsys.readouterr().out)
    assert "2 axis2 1.00 %, 1 0.50 %, 0.5 0.2 (repeats)" in said
    assert "cable c1 > 1.5 N m/rad (c2 0.5)" in said

"""A few cases of the judge from end to end, and that the judge itself counts right."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from runtime.recordings import recording
from tests import bank
from tests.judge import confusion, coverage, forms, limits, rates, scoring
from tests.judge.bodies import ARMS
from tests.judge.cases import Case, Made, Setting, cases
from tests.judge.hidden import ENTRIES, Hidden, Setup
from tests.judge.line import Line, append, blank, read, write
from tests.judge.motion import desired
from tests.judge.save import save
from tests.judge.situations import SITUATIONS
from tests.kept import kept
from tests.variants import slow

SEED = 42


def one(name: str, size: float = 1.0) -> Case:
    return next(iter(cases([name], [1], [size], [SEED], Setting())))


@pytest.mark.parametrize("name", ["stribeck", "elasticity", "outside_sine"])
def test_a_clear_case_is_judged_right(name: str) -> None:
    row = kept(bank.judged, one(name))
    assert row.outcome == "right", row
    assert row.column == ("unexplained" if name == "outside_sine" else name)
    # 1.5 is what is asked of a transmission; a disturbance from outside stays in the error.
    assert 0.95 < row.ratio < 1.5
    assert row.exact == (name != "outside_sine") == bool(coverage.from_text(row.covered))


@pytest.mark.parametrize("name", ["backlash", slow("backlash_hertz")])
def test_a_gap_of_some_encoder_steps_is_named(name: str) -> None:
    """Half as much torque as noise: seven to ten times what the encoder's noise is."""
    row = kept(bank.judged, one(name, 0.5))
    assert row.outcome == "right", row


def test_nothing_is_named_where_nothing_is_hidden() -> None:
    (coarse,) = cases(["clean_x10"], [1], [0.0], [SEED], Setting())
    row = kept(bank.judged, coarse)
    assert not row.named
    assert row.outcome in ("right", row.verdict)
    assert row.ratio < 1.5


def test_uncertain_instants_of_reading_are_noise() -> None:
    """Stamps of whole milliseconds: an arm's residual is loud where it is fast."""
    (rounded,) = cases(["clean_rounded"], [6], [0.0], [400], Setting(excitation="brief"))
    row = kept(bank.judged, rounded)
    assert (row.verdict, row.named) == ("clean", ""), row.reason


@pytest.mark.parametrize(
    ("name", "joints", "situation", "truth"),
    [
        ("load_friction_upright", 1, "bus", "load_friction@1"),
        ("gravity_left_out+load_friction", 1, "hz500", "gravity load_friction@1"),
        ("ripple_lines", 1, "rate_filtered", "torque_ripple@1"),
        ("coupled_gear", 2, "quantised", "coupled_gear@1"),
        ("cable_pack", 1, "lost", "cable@1"),
        ("delay_of_samples", 1, "link_late", "torque_delay@1"),
    ],
)
def test_a_case_of_an_arm_as_real_ones_are_is_judged(name: str, joints: int, situation: str, truth: str) -> None:
    """Whatever the answer: it is made, it has its size, it goes through a file and is counted."""
    setting = replace(SITUATIONS[situation], excitation="brief")
    (case,) = cases([name], [joints], [1.0], [SEED], setting)
    row = kept(bank.judged, case)
    assert row.outcome in ("right", "rival", "missed", "half", "wrong"), row.reason
    assert row.truth == truth
    if name != "delay_of_samples":  # which is as large as its time makes it
        assert row.sizes[-1] == pytest.approx(1.0, rel=0.11)
    assert row.lines.endswith("/3") == (name == "ripple_lines")
    assert np.isfinite(row.ratio)


def test_a_case_is_saved_to_be_looked_at(tmp_path: Path) -> None:
    (brief,) = cases(["load_friction_upright"], [1], [1.0], [SEED], Setting(excitation="brief"))
    path = save(brief, tmp_path)
    assert sorted(p.name for p in path.iterdir()) == ["fit.csv.gz", "held.csv.gz", "model.toml", "truth.json"]
    truth = json.loads((path / "truth.json").read_text())
    assert truth["hidden"] == ["load_friction@1"]
    assert truth["plant"][0]["LOAD"] == pytest.approx(truth["amounts"][0])
    assert recording.read(path / "fit.csv.gz", None).q.shape == recording.read(path / "held.csv.gz", None).q.shape


# the judge itself ----------------------------------------------------------------------------------------------------


def made(case: Case, truth: tuple[Hidden, ...] = (), joints: tuple[int | None, ...] = ()) -> Made:
    return cast(Made, SimpleNamespace(case=case, hidden=truth, joints=joints))


def named(effect: str, joint: int | None, *rivals: tuple[str, int | None]) -> dict[str, Any]:
    return {"effect": effect, "joint": joint, "rivals": [{"effect": e, "joint": j} for e, j in rivals]}


SPRING = Hidden("linear_spring", 1.0, (0.1, 1.0), rivals=("gravity", "cable"))
CREEP = Hidden("stribeck", 1.0, (0.1, 1.0))


def test_outcomes_of_one_effect() -> None:
    hidden = made(one("stribeck"), (CREEP,), (2,))
    for findings, outcome, column in (
        ([], "missed", "-"),
        ([named("stribeck", 2)], "right", "stribeck"),
        ([named("stribeck", 1)], "wrong", "other joint"),
        ([named("lugre", 2, ("stribeck", 2))], "rival", "lugre"),
        ([named("lugre", 2), named("stribeck", 2)], "wrong", "lugre"),
    ):
        score = scoring.judged(hidden, findings, "effect" if findings else "clean")
        assert score.outcome == outcome
        assert score.among == any("stribeck" in str(f) and "2" in str(f) for f in findings)
        assert scoring.column(hidden, findings, "effect" if findings else "clean") == column


def test_a_rival_is_right_where_the_experiment_separates_it() -> None:
    hidden = made(one("linear_spring"), (SPRING,), (1,))
    findings = [named("gravity", None, ("linear_spring", 1))]
    assert scoring.judged(hidden, findings, "effect").outcome == "rival"
    assert (
        scoring.judged(hidden, findings, "effect", lambda a, b: (a, b) == ("gravity", "linear_spring@1")).outcome
        == "right"
    )
    assert scoring.judged(hidden, findings, "effect", lambda *_: False).outcome == "rival"
    friction = [named("lugre", 1, ("linear_spring", 1))]
    assert scoring.judged(hidden, friction, "effect", lambda *_: True).outcome == "rival"


def test_outcomes_of_a_pair() -> None:
    hidden = made(one("stribeck+linear_spring"), (CREEP, SPRING), (1, 1))
    both = [named("linear_spring", 1), named("stribeck", 1)]
    third = [*both, named("offset", 1)]
    near = [named("gravity", None), named("stribeck", 1)]
    scores = [scoring.judged(hidden, x, "effect") for x in (both, third, near, both[:1], [named("offset", 1)])]
    assert [s.outcome for s in scores] == ["right", "right", "rival", "half", "wrong"]
    assert [s.extra for s in scores] == [0, 1, 0, 0, 1]


def test_nothing_hidden_accepts_the_verdicts_of_its_case_only() -> None:
    strong = made(next(c for c in cases(["clean"], [1], [0.0], [SEED], Setting()) if c.label == "clean_strong"))
    assert scoring.judged(strong, [], "unexplained").outcome == "right"
    assert scoring.judged(strong, [], "refused").outcome == "refused"
    assert scoring.judged(strong, [named("offset", 1)], "effect").outcome == "wrong"


def test_intervals_hold_together_when_they_are_widened_for_their_number() -> None:
    rng = np.random.default_rng(0)
    held, inside, of = 0, 0, 0
    for _ in range(2000):
        found = [(x - 1.96, x + 1.96) for x in rng.standard_normal(5)]
        counted = scoring.agreement(found, [0.0] * 5)
        inside, of, held = inside + counted[0], of + counted[1], held + counted[2]
    # Three standard errors of 10000 and of 2000 draws.
    assert inside / of == pytest.approx(0.95, abs=0.0065)
    assert held / 2000 == pytest.approx(0.95, abs=0.015)


def test_exact_intervals_of_a_rate() -> None:
    """Against Clopper & Pearson as tabled, and the rule of three."""
    assert rates.Rate("", 8, 10).interval == pytest.approx((0.4439, 0.9748), abs=1e-4)
    low, high = rates.Rate("", 300, 300).interval
    assert low == pytest.approx(1 - 3.689 / 300, abs=2e-4)
    assert high == 1.0


def test_a_limit_becomes_an_amount_a_little_beyond_it() -> None:
    seen = [
        {"effect": "stribeck", "joint": 1, "parameter": "torque", "above": 0.1, "unit": "N m"},
        {"effect": "elasticity", "joint": 1, "parameter": "stiffness", "below": 3000.0, "unit": "N m/rad"},
        {"effect": "torque_saturation", "joint": 2, "parameter": "coefficient", "above": 1e-3, "unit": "1/(N^2 m^2)"},
    ]
    assert limits.beyond(seen, "stribeck", 1) == pytest.approx(0.1 * limits.BEYOND)
    assert limits.beyond(seen, "elasticity", 1) == pytest.approx(3000.0 / limits.BEYOND)
    assert limits.beyond(seen, "stribeck", 2) is None
    strongest = limits.beyond(seen, "torque_saturation", 2)
    assert strongest is not None
    small = 1e-2 * strongest
    assert small - strongest * np.tanh(small / strongest) == pytest.approx(1e-3 * limits.BEYOND * small**3, rel=1e-3)
    assert set(limits.AMOUNTS) <= set(ENTRIES)


def test_every_form_of_the_library_has_another_or_a_reason() -> None:
    """The reasons are in forms.py's own words."""
    rng = np.random.default_rng(0)
    wanted = desired(rng, 2)
    classes = {
        kind: {entry.draw(Setup(ARMS[2], 0, wanted, rng)).truth for entry in ENTRIES.values() if entry.kind == kind}
        for kind in ("single", "forms")
    }
    without = classes["single"] - classes["forms"]
    plain = {"coulomb", "coulomb_asymmetric", "offset", "viscous", "linear_spring", "torque_scale", "gravity"}
    plain |= {"torque_delay"}
    assert without == plain | {"coupled_gear"}
    assert all(name in str(forms.__doc__) for name in without)


def test_a_table_is_read_back_as_it_was_written(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    row = replace(blank(one("stribeck")), outcome="right", size="0.51", seconds=1.5, among=True, reason='a "b", c')
    write(path, [])
    append(path, row)
    (back,) = read(path)
    assert back.key == row.key
    assert (back.among, back.reason, back.sizes) == (True, row.reason, [0.51])
    path.write_text("a,b\n1,2\n")
    with pytest.raises(ValueError, match="not a table"):
        read(path)


def test_the_matrix_and_the_rates_count_every_row(tmp_path: Path) -> None:
    def row(name: str, kind: str, outcome: str, column: str, size: str = "0.50", **more: Any) -> Line:
        return replace(Line(name, kind, 1, 1, "", 0.5, outcome=outcome, column=column, size=size), **more)

    lines = [
        row("stribeck", "single", "right", "stribeck", named="stribeck@1", exact=True, ratio=1.02, seconds=1.0),
        row("stribeck", "single", "wrong", "lugre", named="lugre@1", ratio=1.3),
        row("stribeck", "single", "missed", "-", size="0.10"),
        row("clean", "clean", "right", "-", size="", ratio=1.0, seconds=1.0),
        row("outside_sine", "unknown", "right", "unexplained", size="0.6"),
        row("stribeck_lorentz", "forms", "failed", ""),
    ]
    table = confusion.counts(lines)
    assert table["stribeck"] == {"stribeck": 1, "lugre": 1, "-": 1}
    assert table["stribeck_lorentz"] == {"failed": 1}
    printed = confusion.text(lines, width=80)
    assert max(map(len, printed)) <= 80
    assert any(x.split() == ["stribeck", "3", "1", "1", "1", "."] for x in printed)
    found = {r.name: (r.hits, r.total) for r in rates.rates(lines)}
    assert found["one effect of size >= 0.45, 1R: named first"] == (1, 2)
    assert found["one effect of size >= 0.45, 1R: exactly"] == (1, 2)
    assert found["one effect of size < 0.15: nothing named"] == (1, 1)
    assert found["nothing hidden: nothing named"] == (1, 1)
    assert found["static: held-out error within 1.1 of the floor"] == (1, 2)
    assert found["the judge itself failed"] == (1, 6)
    confusion.write(tmp_path / "m.csv", lines)
    assert (tmp_path / "m.csv").read_text().splitlines()[0] == "truth,stribeck,lugre,-,unexplained,failed"

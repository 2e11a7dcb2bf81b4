"""Samples that are not what the joint did: repaired with a note, or refused with the row, the count and the cure."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from runtime.arrays import Array
from runtime.cli import main, output
from runtime.diagnosis.stages import diagnose
from runtime.recordings.columns import RecordedArm
from runtime.recordings.contents import RecordingError, Refusal
from runtime.recordings.in_memory import of_frame
from runtime.recordings.recording import Recording, checked, read
from symbolic.model_file.arm import DescribedJoint
from tests import bank, plants

Columns = dict[str, Array]

SHARED = Path(__file__).parents[4] / "shared" / "data"
RATES = (50.0, 250.0, 1000.0, 5000.0)
STEP = 2 * np.pi / 200_000


@cache
def motion(rate: float, noise: float, seed: int = 3) -> Columns:
    """Two joints that move, rest for a while and reverse, with an encoder's steps and dry friction."""
    rng = np.random.default_rng(seed)
    t = np.arange(3000) / rate
    pace = np.interp(np.arange(3000), [0, 900, 1000, 1200, 1300, 3000], [1, 1, 0, 0, 1, 1])
    way = 2 * np.pi * np.cumsum(pace) / np.sum(pace)
    made: Columns = {"t": t}
    for i, times in ((1, 3.0), (2, 4.0)):
        q = 0.9 * np.sin(times * way) + 0.3 * np.sin(3 * times * way + i)
        qd = np.gradient(q, t)
        tau = 8 * np.cos(q + 0.3) + 1.5 * np.tanh(qd / 0.01) + 0.7 * qd / rate + noise * rng.standard_normal(len(t))
        made |= {f"q{i}": np.round(q / STEP) * STEP, f"tau{i}": tau}
    return made


def recording(columns: Columns, allow_gaps: bool = False, arm: RecordedArm | None = None, **mapping: str) -> Recording:
    refuse = Refusal("run.csv")
    return checked(of_frame(columns, mapping, refuse), Path("run.csv"), arm, mapping, allow_gaps, refuse)


def left_out(columns: Columns) -> set[int]:
    """Rows that --allow-gaps leaves out; without it they are refused in one line that counts them."""
    there = recording(columns, allow_gaps=True)
    rows = set(range(len(columns["t"]))) - set(np.searchsorted(columns["t"], there.t).tolist())
    if rows:
        with pytest.raises(RecordingError, match=rf"in {len(rows)} of {len(columns['t'])} rows.*--allow-gaps") as error:
            recording(columns)
        assert "\n" not in str(error.value)
    return rows


def changed(columns: Columns, name: str, change: Callable[[Array], Array]) -> Columns:
    return columns | {name: change(columns[name].copy())}


@settings(max_examples=40, deadline=None)
@given(
    rate=st.sampled_from(RATES),
    noise=st.sampled_from((0.0, 0.05)),
    name=st.sampled_from(("q1", "q2", "tau1", "tau2")),
    value=st.sampled_from((0.0, -1.0, 65535.0, 1e4)),
    rows=st.sets(st.integers(2, 140), min_size=1, max_size=6),
    length=st.integers(1, 5),
)
def test_reads_that_fail_are_left_out_and_no_others(rate, noise, name, value, rows, length):
    """All that are far from the motion, in each signal, at each rate, to any number, 15 good ones apart."""
    good = motion(rate, noise)
    hit = {20 * r + j for r in rows for j in range(length)}
    at = sorted(hit)
    if np.abs(good[name][at] - value).min() < (0.35 if name[0] == "q" else 6.0):
        return
    ways = np.sign(np.diff(good[f"q{name[-1]}"]))
    if name[0] == "t" and any(np.ptp(ways[k - 3 : k + 4]) == 2 for k in at):
        return  # where the joint turns round, its friction does

    def fails(x: Array) -> Array:
        x[at] = value
        return x

    assert left_out(changed(good, name, fails)) == hit


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_a_motion_that_rests_and_reverses_is_believed(rate, noise):
    assert recording(motion(rate, noise)).notes == ()


def test_a_torque_beyond_all_others_is_believed_where_the_joint_is_thrown_back():
    """Twice, within two rows, at a slow rate, also the other joint's; a read that fails elsewhere is still one."""
    slow = motion(50.0, 0.05)
    way = 0.01 * np.convolve(np.cumsum(np.where(np.arange(3004) // 1000 % 2, -1.0, 1.0)), np.full(5, 0.2), "valid")
    force = 5000.0 * np.diff(way, 2, prepend=way[:1], append=way[-1:])
    thrown = slow | {"q1": np.round(way / STEP) * STEP, "tau1": slow["tau2"] + force}
    assert np.abs(force).max() > 2 * np.abs(slow["tau2"]).max()
    assert left_out(thrown) == set()
    assert left_out(changed(thrown, "tau2", lambda x: x - force)) == set()
    assert left_out(changed(thrown, "tau1", lambda x: np.where(np.arange(3000) == 700, x + 30.0, x))) == {700}


def test_a_torque_for_one_sample_is_believed_where_all_take_a_new_level():
    """A controller that begins another phase; beside it a read that fails is still one, and so is a row of them."""
    new, once = (np.where(at, 10.0, 0.0) for at in (np.arange(3000) >= 900, np.arange(3000) == 900))
    level = {"tau1": new / 2 + once, "tau2": new}
    phases = {name: x + level.get(name, 0.0) for name, x in motion(1000.0, 0.05).items()}
    assert left_out(phases) == set()
    assert left_out(changed(phases, "tau1", lambda x: np.where(np.arange(3000) == 700, x + 10.0, x))) == {700}
    row = {name: x + once * name.startswith("tau") for name, x in motion(1000.0, 0.05).items()}
    assert left_out(row) == {900}


@settings(max_examples=15, deadline=None)
@given(part=st.floats(0.01, 0.85), name=st.sampled_from(("tau1", "tau2")), seed=st.integers(0, 99))
@example(part=0.01171875, name="tau1", seed=67)
def test_a_torque_that_is_zero_in_a_part_of_the_rows(part, name, seed):
    """Of fewer than a seventh that are left, two are as far apart as from 0."""
    zero = np.random.default_rng(seed).random(3000) < part
    columns = changed(motion(250.0, 0.05), name, lambda x: np.where(zero, 0.0, x))
    with pytest.raises(RecordingError, match=f"{name} is 0 beside .* in {zero.sum()} of 3000 rows"):
        recording(columns)


def test_a_torque_that_is_zero_for_seconds_while_the_joint_moves():
    def fails(x: Array) -> Array:
        x[1500:2200] = 0.0
        return x

    assert left_out(changed(motion(250.0, 0.05), "tau2", fails)) == set(range(1500, 2200))


def test_a_drive_that_is_off_is_no_failure():
    """An arm that coasts needs no torque: 0 is true."""
    t = np.arange(4000) / 200
    on = t < 12
    q = np.where(on, np.sin(2 * t) + 0.4 * np.sin(5 * t), 0.0)
    speed, start = 2 * np.cos(24) + 2 * np.cos(60), np.sin(24) + 0.4 * np.sin(60)
    q[~on] = start + speed * (1 - np.exp(-(t[~on] - 12)))  # viscous friction alone
    qd, qdd = np.gradient(q, t), np.gradient(np.gradient(q, t), t)
    tau = np.where(on, qdd + qd + 0.02 * np.random.default_rng(0).standard_normal(len(t)), 0.0)
    assert left_out({"t": t, "q1": q, "tau1": tau}) == set()


@settings(max_examples=20, deadline=None)
@given(
    rate=st.sampled_from(RATES),
    turns=st.floats(1.0, 3.0),
    low=st.sampled_from((-np.pi, 0.0, -2 * np.pi)),
    step=st.sampled_from((1e-6, 2 * np.pi / 4096)),
)
def test_turns_are_unwrapped(rate, turns, low, step):
    """By whole turns the same motion, at any branch and of any encoder."""
    good = motion(rate, 0.05)
    whole = np.round(2 * np.pi * turns * good["q1"] / step) * step
    made = recording(good | {"q1": np.mod(whole - low, 2 * np.pi) + low})
    apart = (made.q[0] - whole) / (2 * np.pi)
    np.testing.assert_allclose(apart, np.round(apart[0]), atol=1e-9)
    assert "q1 jumps by a turn of 6.283 rad" in made.notes[0]
    assert made.units["q1"] == "rad"


def test_one_jump_by_a_turn_of_one_joint():
    good = motion(250.0, 0.05)
    made = recording(good | {"q2": good["q2"] + 2 * np.pi * (good["t"] > 4)})
    np.testing.assert_allclose(made.q[1], good["q2"], atol=1e-9)


def test_a_register_of_another_range():
    """0.088 degrees a step are no exact turn."""
    good, step = motion(250.0, 0.05), np.radians(0.088)
    steps = np.round(8 * good["q1"] / step)
    made = recording(good | {"q1": np.mod(steps, 4096) * step})
    assert np.ptp(made.q[0] - steps * step) < 3 * step


def test_what_slides_has_no_turns():
    good = motion(250.0, 0.05)
    arm = RecordedArm((DescribedJoint("prismatic", None, 1.0),) * 2, space=False)
    jumps = good | {"q1": good["q1"] + 2 * np.pi * (good["t"] > 4)}
    assert recording(jumps, arm=arm).notes == ()


def held(x: Array, times: float, first: int = 0) -> Array:
    """Each value so many times."""
    rows = np.unique(np.concatenate([[0], np.floor(np.arange(first, len(x), times)).astype(int)]))
    return x[rows[np.searchsorted(rows, np.arange(len(x)), side="right") - 1]]


@settings(max_examples=20, deadline=None)
@given(rate=st.sampled_from(RATES), noise=st.sampled_from((0.0, 0.05)), times=st.sampled_from((1.25, 2, 3.3, 4, 7)))
def test_values_that_all_come_again_are_read_once(rate, noise, times):
    good = motion(rate, noise)
    made = recording({name: x if name == "t" else held(x, times) for name, x in good.items()})
    assert len(made.t) == pytest.approx(3000 / times, rel=0.01)
    np.testing.assert_array_equal(made.q[0], good["q1"][np.searchsorted(good["t"], made.t)])
    told = re.match(r"all signals: each value comes ([\d.]+) times; read are", made.notes[0])
    assert told is not None
    assert float(told[1]) == pytest.approx(times, rel=0.01)


def test_signals_that_are_renewed_in_different_rows():
    good = motion(250.0, 0.0)
    later = {"q1": 0, "tau1": 0, "q2": 1, "tau2": 1}
    made = recording({name: held(x, 4, later[name]) if name in later else x for name, x in good.items()})
    assert len(made.t) == pytest.approx(750, abs=1)
    np.testing.assert_allclose(made.q[1, 3:], good["q2"][np.searchsorted(good["t"], made.t)][3:], atol=2 * STEP)


@pytest.mark.parametrize("names", [("tau1", "tau2"), ("q1", "q2"), ("tau1",)])
def test_some_that_are_held_are_read_when_they_are_renewed(names):
    good = motion(250.0, 0.05)
    made = recording(good | {name: held(good[name], 4) for name in names})
    np.testing.assert_array_equal(made.tau[0], good["tau1"][::4])
    assert f"{', '.join(names)}: each value comes 4 times; read are the 750 of 3000 rows" in made.notes[0]
    assert "in which values renew, every 16 ms" in made.notes[0]


@pytest.mark.parametrize("hidden", [None, "elasticity"])
def test_what_a_bus_renews_unevenly_names_nothing_that_is_not_there(hidden):
    """Rows at 1 kHz with values of a bus at 66 Hz that is early, late, and loses every tenth: taken for values that
    stayed, these would make an inertia of a quarter and a delay of 90 ms."""
    made, rng = plants.record(hidden, 3), np.random.default_rng(0)
    due = np.arange(0.0, len(made.t) - 20, 15.15)
    rows = np.floor(due + rng.uniform(0, 8, len(due))).astype(int)[rng.random(len(due)) > 0.1]
    last = rows[np.maximum(np.searchsorted(rows, np.arange(len(made.t)), side="right") - 1, 0)]
    found = diagnose(bank.model("drive"), [recording({"t": made.t, "q1": made.q[last], "tau1": made.tau[last]}, True)])
    assert not found.findings
    assert found.last.fit.inference.lumps[0].value == pytest.approx(plants.ROTOR + plants.LINK, rel=0.02)


def test_an_encoder_that_hardly_moves_on_is_not_held():
    good = motion(1000.0, 0.05)
    coarse = {name: np.round(good[name] / 0.01) * 0.01 for name in ("q1", "q2")}
    assert recording(good | coarse).notes == ()


def test_the_rates_of_another_clock_are_not_read():
    good = motion(250.0, 0.05)
    made = recording(good | {"qd1": held(np.gradient(good["q1"], good["t"]), 4)})
    assert made.qd is None
    assert "qd1 repeat" in made.notes[0]


@pytest.mark.parametrize(
    ("file", "statuses", "said"),
    [
        ("02-encoder-dropouts-to-zero/clean.csv", (0, 0), ""),
        ("02-encoder-dropouts-to-zero/one_zero_q2.csv", (1, 2), "line 1460: q2 is 0"),
        ("02-encoder-dropouts-to-zero/rows_of_zeros.csv", (1, 2), "in 6 of 5000 rows"),
        ("03-angle-wrap/one_jump.csv", (0, 0), "q2 jumps by a turn of 6.283 rad 1 times, first at line 1698"),
        ("04-held-samples/both_x4.csv", (0, 0), "all signals: each value comes 4 times"),
        ("04-held-samples/tau_x4.csv", (0, 0), "tau1, tau2: each value comes 4 times"),
    ],
)
def test_files_that_people_meet(capsys, file, statuses, said):
    """inspect marks them, and other verbs do not believe them."""
    path = SHARED / "faults" / file
    if not path.exists():
        pytest.skip(f"{path}: not here")
    model = SHARED / "faults" / "02-encoder-dropouts-to-zero" / "two.toml"
    for arguments, status in zip((("inspect", path, model), ("identify", model, path)), statuses, strict=True):
        assert output.run(main.app, [str(a) for a in arguments]) == status
        captured = capsys.readouterr()
        assert said in " ".join((captured.out + captured.err).split())


REAL = sorted({*SHARED.glob("hidden/*.gz"), *SHARED.glob("real/*/*.gz"), *SHARED.glob("real/go2/rollouts/*.gz")})


@pytest.mark.parametrize("path", REAL, ids=lambda path: f"{path.parent.name}/{path.name}")
def test_real_recordings_are_believed(path):
    """Stick-slip, presliding, chirps, coarse encoders, stale messages, a gap."""
    made = read(path, None, allow_gaps=True)
    assert not any("rows" in note or "turn" in note or "repeat" in note for note in made.notes)

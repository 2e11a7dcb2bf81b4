"""Readers and the numerical verbs on files and recordings that nobody meant: an answer or one line, in time."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from runtime.arrays import Array
from runtime.diagnosis.stages import begin
from runtime.diagnosis.steps import outside
from runtime.identification.identify import prepared
from runtime.model.loader import Model
from runtime.motion import clock, noise, spectra
from runtime.motion.band import credible_inertia
from runtime.motion.settings import LOWEST_CUTOFF
from runtime.recordings import recording
from runtime.recordings.contents import RecordingError
from runtime.recordings.recording import Recording
from runtime.recordings.settings import LONGEST_LINE, MOST_FIELDS
from tests.runtime.conftest import Run

SECONDS = 20
"""Of processor time, a case's limit; each takes less than ten."""
N = 900
MORE = ("qd1", "temperature1", "q1_desired", "q1_link", "tau1_link", "tau1_rigid")


@contextmanager
def in_time() -> Iterator[None]:
    def late(*_: object) -> None:
        pytest.fail(f"no answer in {SECONDS} s")

    before = signal.signal(signal.SIGPROF, late)
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)


def recorded(t: Array, seed: int) -> dict[str, Array]:
    """(N,) of each column that may be recorded of a joint with inertia, dry and viscous friction on sines."""
    rng = np.random.default_rng(seed)
    w = 2 * np.pi * rng.uniform(2.0, 20.0, (3, 1)) / (t[-1] - t[0])
    a, s = rng.uniform(0.1, 1.0, (3, 1)), w * t + rng.uniform(0, 6, (3, 1))
    q, qd, qdd = ((a * w**k * f(s)).sum(axis=0) for k, f in enumerate((np.sin, np.cos, lambda x: -np.sin(x))))
    tau = 0.24 * qdd + 1.1 * np.sign(qd) + 0.4 * qd + 1e-3 * rng.standard_normal(N)
    more = (qd, 20 + rng.standard_normal(N) / 10, q, q - tau / 1e4, tau, 0.24 * qdd)
    return {"q1": q, "tau1": tau, **dict(zip(MORE, more, strict=True))}


K, NOISE = np.arange(N), np.random.default_rng(0).standard_normal(N)
VALUES = st.sampled_from([0.0, -0.0, 5e-324, 1e-300, 1e-150, -1e-12, 1e-9, 1e-3, 1.0, -1.0, 60.0, 1e6, 1e11, -1e12])
BEHIND = st.integers(0, N - 1).map(lambda at: at <= K)
PARTS = st.builds(lambda behind, size: behind & (np.cumsum(behind) <= size), BEHIND, st.sampled_from([1, 2, 50, N]))
OTHERS = [NOISE, np.sin(K / 7), np.floor(K / 100), np.ones(N), K / 1000, np.sign(np.sin(K / 30))]
ODDITIES: st.SearchStrategy[Callable[[Array], Array]] = st.one_of(
    VALUES.map(lambda value: lambda x: x * value),
    VALUES.map(lambda value: lambda x: x + value),
    VALUES.map(lambda value: lambda x: x + value * NOISE),
    st.builds(lambda part, value: lambda x: np.where(part, value, x), PARTS, VALUES | st.just(np.nan)),
    st.integers(-30, 30).map(lambda late: lambda x: np.roll(x, late)),
    st.sampled_from([2, 20, 300]).map(lambda held: lambda x: x[K // held * held]),
    st.just(lambda x: np.round(10 * x) / 10),
    st.just(lambda x: np.clip(x, -0.5, 0.5)),
    st.sampled_from(OTHERS).map(lambda other: lambda _: other),
)
"""What may become of a signal."""
STAMPS = st.one_of(
    st.just(K * 1.0),
    st.floats(0.0, 0.5).map(lambda part: K + part * np.random.default_rng(1).random(N)),
    st.builds(lambda behind, jump: K + jump * behind, BEHIND, st.sampled_from([1, 1.5, 40, -2, -N, 1e9])),
)
"""Clocks, in steps."""


@st.composite
def tables(draw: st.DrawFn) -> str:
    """A text that can be read."""
    dt = draw(st.sampled_from([1e-3, 2e-3, 4e-3, 4e-3, 0.01, 0.01, 0.02, 0.05, 1e-9, 1.0]))
    columns = {"t": dt * draw(STAMPS) + draw(st.sampled_from([0.0, 0.0, 1.7e9]))}
    meant = recorded(dt * K, draw(st.integers(0, 99)))
    for name in ("q1", "tau1", *draw(st.lists(st.sampled_from(MORE), unique=True, max_size=2))):
        columns[name] = meant[name]
        for odd in draw(st.lists(ODDITIES, max_size=2)):
            columns[name] = odd(columns[name])
    rows = "\n".join(",".join(repr(float(x)) for x in row) for row in zip(*columns.values(), strict=True))
    return f"{','.join(columns)}\n{rows}\n"


SHORT = ((0, 0.0), (3, 5e-324), (50, 1e-160), (50, 1e-140))
"""Of a torque, samples that are not zero and what the others are: the cases of `make test`."""


def check_answer(status: int, err: str) -> None:
    """Done, "no", or bad input in one line, behind notes of how it was read; nothing of Python."""
    lines = [line for line in err.splitlines() if not line.endswith("…")]
    assert status in (0, 1, 2), err
    assert "Traceback" not in err
    assert "Warning" not in err, err
    if status == 2:
        assert lines, err
        assert all(".csv: " in line for line in lines[:-1]), err


@pytest.mark.parametrize(
    ("verb", "examples"),
    [
        *((verb, 6) for verb in ("compare", "identify", "diagnose")),
        *(pytest.param(verb, 200, marks=pytest.mark.slow) for verb in ("compare", "identify", "diagnose")),
    ],
)
@pytest.mark.filterwarnings("error", "ignore:Generating overly large repr")
def test_a_verb_answers_whatever_was_recorded(
    tmp_path_factory: pytest.TempPathFactory, tendon: Run, verb: str, examples: int
) -> None:
    path = tmp_path_factory.mktemp("odd") / "run.csv"

    @settings(max_examples=examples, database=None, suppress_health_check=list(HealthCheck))
    @given(tables())
    def answers(text: str) -> None:
        path.write_text(text)
        with in_time():
            status, _, err = tendon(verb, "drive", path, "--allow-gaps")
        check_answer(status, err)

    answers()


def read(columns: dict[str, Array], dt: float = 4e-3) -> Recording:
    """(N,) of each column, or (n, N)."""
    q, tau, qd = (np.atleast_2d(columns[name]) if name in columns else None for name in ("q1", "tau1", "qd1"))
    assert q is not None
    assert tau is not None
    n, whole = len(q), np.zeros(N, dtype=np.int64)
    return Recording(Path("run.csv"), dt * K, whole, q, tau, ("revolute",) * n, (slice(0, N),), (None,) * n, qd=qd)


@pytest.mark.filterwarnings("error")
def test_no_acceleration_under_a_torque_is_no_inertia_that_is_known() -> None:
    assert credible_inertia(np.array([np.nan]), [read({"q1": np.zeros(N), "tau1": 1e11 * NOISE})]) == np.inf
    assert credible_inertia(np.array([0.3]), [read({"q1": np.zeros(N), "tau1": 1e11 * NOISE})]) == 0.3


@pytest.mark.filterwarnings("error")
def test_torque_without_friction_is_all_noise_at_rest(drive: Model) -> None:
    """With a wrong sign, friction drives."""
    meant = recorded(4e-3 * K, 0)
    assert prepared(drive, [read({"q1": meant["q1"], "tau1": -1e10 * meant["tau1"]})]).quiet == np.inf


@pytest.mark.filterwarnings("error")
def test_a_motion_of_less_than_a_second_leaves_something_that_is_said(drive: Model) -> None:
    meant = recorded(1e-3 * K, 0)
    step = begin(drive, [read({**meant, "tau1": meant["tau1"] + 5 * np.sin(K / 7)}, dt=1e-3)]).steps[0]
    assert step.fit.motion.row_rate(0) > len(step.fit.motion.row_piece(0))
    found = outside(step, 0)
    assert found is not None
    assert not found.repeats


@pytest.mark.filterwarnings("error")
def test_a_rate_beside_a_joint_that_does_not_move_is_left_alone() -> None:
    meant = recorded(4e-3 * K, 0)
    both = {name: np.array([meant[name]] * 2) for name in ("tau1", "qd1")}
    recording = read({"q1": np.array([meant["q1"], 5e-324 * np.round(3 * NOISE)]), **both})
    grids = [clock.grid(recording)]
    moved, still = (noise.measured_rate(i, [recording], grids, LOWEST_CUTOFF, 1e-12) for i in range(2))
    assert moved is not None
    assert still is None


@pytest.mark.parametrize("size", [5e-324, 1e-300, 1e-14])
def test_what_no_encoder_tells_is_no_motion(tmp_path: Path, tendon: Run, size: float) -> None:
    rows = "".join(f"{k / 100},{size * (k % 7)!r},{k % 5}\n" for k in range(300))
    (tmp_path / "run.csv").write_text("t,q1,tau1\n" + rows)
    status, _, err = tendon("compare", "drive", tmp_path / "run.csv")
    assert status == 2
    assert "q1 is constant; nothing moves" in err


@pytest.mark.parametrize("verb", ["identify", "diagnose"])
@pytest.mark.parametrize(
    ("told", "rest"),
    [
        pytest.param(told, rest, marks=() if (told, rest) in SHORT else pytest.mark.slow)
        for told in (0, 2, 3, 50)
        for rest in (0.0, 5e-324, 1e-160, 1e-140)
    ],
)
@pytest.mark.filterwarnings("error")
def test_a_torque_of_a_few_samples_and_nothing_after_them(
    tmp_path: Path, tendon: Run, verb: str, told: int, rest: float
) -> None:
    """What a filter leaves of it later is no torque that an error can be relative to."""
    path, meant = tmp_path / "run.csv", recorded(1e-3 * K, 0)
    tau = np.where(told > K, 500.0, rest)
    rows = (f"{1e-3 * k!r},{float(meant['q1'][k])!r},{float(tau[k])!r}\n" for k in range(N))
    path.write_text("t,q1,tau1\n" + "".join(rows))
    status, _, err = tendon(verb, "drive", path, "--allow-gaps")
    check_answer(status, err)


@pytest.mark.filterwarnings("error")
def test_a_rigid_torque_that_is_all_of_the_torque(tmp_path: Path, tendon: Run) -> None:
    """What the model leaves is mere rounding."""
    path, meant = tmp_path / "run.csv", recorded(4e-3 * K, 12)
    table = np.array([4e-3 * K, meant["q1"], K / 1000, K / 1000, np.repeat(meant["q1_link"][::2], 2)]).T
    rows = "".join(",".join(map(repr, row)) + "\n" for row in table.tolist())
    path.write_text("t,q1,tau1,tau1_rigid,q1_link\n" + rows)
    status, _, err = tendon("diagnose", "drive", path, "--report", tmp_path / "page")
    check_answer(status, err)


@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in (1, 2))])
@pytest.mark.filterwarnings("error")
def test_where_nothing_wavers_all_is_above_the_floor(tmp_path: Path, tendon: Run, seed: int) -> None:
    """Of most of a recording nothing but zeros: no torque wavers, and the floor is zero."""
    path = tmp_path / "run.csv"
    meant, told = recorded(0.01 * K, seed), K < 249
    table = np.array([0.01 * K + 1e7 * ~told, told * meant["q1"], told * meant["tau1"]]).T
    path.write_text("t,q1,tau1\n" + "".join(",".join(map(repr, row)) + "\n" for row in table.tolist()))
    status, _, err = tendon("diagnose", "drive", path, "--allow-gaps", "--report", tmp_path / "page")
    check_answer(status, err)


@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in range(1, 6))])
@pytest.mark.filterwarnings("error")
def test_an_angle_without_digits_tells_nothing_of_a_link(tmp_path: Path, tendon: Run, seed: int) -> None:
    """The motor's angle begins at 1e11 rad: the rest of its digits is coarser than the twist of the transmission."""
    path = tmp_path / "run.csv"
    t = 4e-3 * (K + 0.5 * np.random.default_rng(seed).random(N))
    meant = recorded(t, seed)
    table = np.array([t, 1e11 + meant["q1"], meant["tau1"], meant["q1_link"]]).T
    path.write_text("t,q1,tau1,q1_link\n" + "".join(",".join(map(repr, row)) + "\n" for row in table.tolist()))
    status, _, err = tendon("diagnose", "drive", path, "--allow-gaps")
    check_answer(status, err)


@pytest.mark.filterwarnings("error")
def test_bursts_in_silence_are_bursts() -> None:
    x, use = np.zeros(100), np.ones(100, dtype=bool)
    assert spectra.bursts(x, use, use * 1.0, 10.0)[0] == 1.0
    x[[15, 55]] = 1.0
    worst, rows = spectra.bursts(x, use, use * 1.0, 10.0)
    assert worst == np.inf
    assert rows.tolist() == [10, 50]


def test_what_is_too_long_is_refused_before_it_is_understood(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def said(text: str) -> str:
        (tmp_path / "run.csv").write_text(text)
        with pytest.raises(RecordingError) as caught:
            recording.read(tmp_path / "run.csv", None)
        return str(caught.value).removeprefix(f"{tmp_path}/")

    rows = "".join(f"{k / 1000},{k % 7},{k % 5}\n" for k in range(300))
    longest = f"is longer than {LONGEST_LINE} bytes"
    assert longest in said("t,q1,tau1," + "x" * 3 * LONGEST_LINE + "\n" + rows)
    assert longest in said("t,q1,tau1\n" + rows + "9" * 3 * LONGEST_LINE)
    assert f"expected at most {MOST_FIELDS}" in said("t,q1,tau1" + ",a" * MOST_FIELDS + "\n" + rows)
    monkeypatch.setattr("runtime.recordings.contents.MOST_SAMPLES", 250)
    assert said("t,q1,tau1\n" + rows).startswith("run.csv: has more than 250 samples; split it")


@pytest.mark.parametrize("size", [1, 7, 64, 1 << 20])
def test_blocks_change_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, size: int) -> None:
    """Whatever a block ends in: a line, a number, half of an end of a line, half of a letter."""
    rows = "\r\n".join(f"{k / 1000!r};{float(np.sin(k / 50))!r};{float(np.cos(k / 20))!r};é" for k in range(260))
    path = tmp_path / "run.csv"
    path.write_bytes(f"# mesuré\r\nt;q1;tau1;naïf\r\n\r\n{rows}\r\n\r\n".encode("utf-8-sig"))
    monkeypatch.setattr("runtime.recordings.text.blocks.__defaults__", (size,))
    read = recording.read(path, None)
    k = np.arange(260)
    assert np.array_equal(read.t, k / 1000)
    assert np.array_equal(read.q[0], np.sin(k / 50))
    assert np.array_equal(read.tau[0], np.cos(k / 20))

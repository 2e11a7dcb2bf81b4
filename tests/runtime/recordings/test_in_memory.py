"""Recordings from arrays and data frames: the same as from a file, and the same refusals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from runtime.notebook.arm import load, recording
from runtime.recordings.recording import Recording

N = 400


@pytest.fixture
def motion() -> dict[str, np.ndarray]:
    """t (N,), q and tau (N, 2)."""
    t = 0.001 * np.arange(N)
    q = np.stack([np.sin(9 * t), 0.5 * np.cos(7 * t)], axis=1)
    return {"t": t, "q": q, "tau": 3 * np.cos(5 * t)[:, None] + q}


def same(one: Recording, other: Recording) -> None:
    for name in ("t", "q", "tau", "qd", "force"):
        mine, theirs = getattr(one, name), getattr(other, name)
        assert (mine is None) == (theirs is None)
        if mine is not None:
            np.testing.assert_allclose(mine, theirs, rtol=1e-11, atol=1e-13)
    assert one.segments == other.segments


def test_arrays_are_what_their_file_is(motion: dict[str, np.ndarray], tmp_path: Path) -> None:
    q = motion["q"]
    made = recording(**motion, qd=np.gradient(q, 0.001, axis=0), force=np.ones((N, 6)))
    made.save(tmp_path / "run.csv")
    same(made, recording(tmp_path / "run.csv"))
    assert made.q.shape == (2, N)
    assert repr(made) == "recording: 2 joints, 400 samples, 0.4 s at 1000 Hz, with qd, force"


def test_a_single_joint_may_be_flat(motion: dict[str, np.ndarray]) -> None:
    flat = recording(t=motion["t"], q=motion["q"][:, 0], tau=motion["tau"][:, 0], arm=load("drive"))
    same(flat, recording(t=motion["t"], q=motion["q"][:, :1], tau=motion["tau"][:, :1]))


def test_units_and_torque_constants_convert(motion: dict[str, np.ndarray]) -> None:
    arm = load("vishard4")
    q, amps = np.tile(motion["q"], 2), np.tile(motion["tau"], 2)
    made = recording(t=1e3 * motion["t"], q=np.degrees(q), tau=amps, units={"t": "ms", "q": "deg"}, arm=arm)
    np.testing.assert_allclose(made.q, q.T)
    np.testing.assert_allclose(made.t, motion["t"])
    unknown = recording(t=motion["t"], q=q, tau=amps, units={"tau": "mA"})
    assert unknown.currents == {"tau1", "tau2", "tau3", "tau4"}
    np.testing.assert_allclose(unknown.tau, 1e-3 * amps.T)


def test_a_data_frame_reads_like_the_csv_of_it(motion: dict[str, np.ndarray], tmp_path: Path) -> None:
    frame = pd.DataFrame({"time": motion["t"], "pos": np.degrees(motion["q"][:, 0]), "cur [mNm]": motion["tau"][:, 0]})
    columns = {"t": "time", "q1": "-pos [deg]", "tau1": "cur"}
    frame.to_csv(tmp_path / "log.csv", index=False)
    from_frame = recording(frame, columns=columns)
    same(from_frame, recording(tmp_path / "log.csv", columns=columns))
    np.testing.assert_allclose(from_frame.q[0], -motion["q"][:, 0])
    same(from_frame, recording({name: frame[name] for name in frame}, columns=columns))


@pytest.mark.parametrize("kind", ["float", "duration", "date", "column"])
def test_the_index_may_be_the_time(motion: dict[str, np.ndarray], kind: str) -> None:
    frame = pd.DataFrame({"q1": motion["q"][:, 0], "tau1": motion["tau"][:, 0], "note": "by hand"})
    durations = pd.to_timedelta(motion["t"], unit="s")
    index = {"float": motion["t"], "duration": durations, "date": pd.Timestamp("2026-03-01 12:00") + durations}
    if kind == "column":
        frame["t"] = index["date"]
    else:
        frame.index = pd.Index(index[kind])
    np.testing.assert_allclose(recording(frame).t, motion["t"], atol=1e-12)


def test_any_frame_with_columns_will_do(motion: dict[str, np.ndarray]) -> None:
    class Frame:
        """As polars has it: names and columns, no index."""

        columns = ("t", "q1", "tau1")

        def __getitem__(self, name: str) -> np.ndarray:
            return {"t": motion["t"], "q1": motion["q"][:, 0], "tau1": motion["tau"][:, 0]}[name]

    assert recording(Frame(), name="flight 3").path == Path("flight 3")


def test_the_recording_keeps_its_own_numbers(motion: dict[str, np.ndarray]) -> None:
    made = recording(**motion)
    before = made.q.copy()
    motion["q"][:] = 0
    np.testing.assert_array_equal(made.q, before)


def test_refusals_name_signal_place_and_argument(motion: dict[str, np.ndarray]) -> None:
    t, q, tau = motion["t"], motion["q"], motion["tau"]
    with pytest.raises(ValueError, match=r"recording: q has shape \(2, 400\); expected \(400, n\).*; pass q\.T"):
        recording(t=t, q=q.T, tau=tau)
    with pytest.raises(ValueError, match="tau has 1 columns; expected 2, as q"):
        recording(t=t, q=q, tau=tau[:, 0])
    with pytest.raises(ValueError, match=r"no tau; expected t \(N,\), q \(N, n\) and tau"):
        recording(t=t, q=q)
    with pytest.raises(ValueError, match="q2 is NaN; drop the row or pass allow_gaps=True") as found:
        recording(t=t, q=np.where(np.arange(2 * N).reshape(N, 2) == 201, np.nan, q), tau=tau)
    assert str(found.value).startswith("recording sample 100: ")
    with pytest.raises(ValueError, match=r'if t is in ms, pass columns=\{"t": "t \[ms\]"\}'):
        recording(pd.DataFrame({"t": 1e3 * t, "q1": q[:, 0], "tau1": tau[:, 0]}))
    with pytest.raises(ValueError, match="tau1 is object; expected numbers"):
        recording(pd.DataFrame({"t": t, "q1": q[:, 0], "tau1": ["much"] * N}))
    with pytest.raises(ValueError, match=r'no column q2 .* name it with columns=\{"q2":'):
        recording(pd.DataFrame({"t": t, "q1": q[:, 0], "tau1": tau[:, 0], "p2": t, "tau2": t}))
    with pytest.raises(ValueError, match="units: no signal current; there is t, q, tau"):
        recording(**motion, units={"current": "mA"})
    with pytest.raises(ValueError, match="both a source and q"):
        recording("run.csv", q=q)
    with pytest.raises(ValueError, match="is a ndarray; expected a file, a data frame"):
        recording(q)
    with pytest.raises(ValueError, match="has a column q2, but the model has 1 joint"):
        recording(**motion, arm="drive")

"""What the fields of a file contain before any is read as a signal."""

from __future__ import annotations

import numpy as np
import pytest

from runtime.recordings.contents import Refusal
from runtime.recordings.preview import previews
from runtime.recordings.recording import opened

N = 300


def test_numbers_dates_and_words_of_a_text(tmp_path):
    """A field that is none of numbers has no preview, and does not take away those of others."""
    path = tmp_path / "log.csv"
    stamps = [f"2026-05-01T12:{k // 60:02}:{k % 60:02}" for k in range(N)]
    rows = [f"{stamp};{k};{-k / 2};RUN;{'nan' if k == 0 else k}" for k, stamp in enumerate(stamps)]
    path.write_text("\n".join(["stamp;count;Pos [deg];state;some", *rows]) + "\n")
    stamp, count, pos, state, some = previews(opened(path, Refusal("log.csv")))
    assert [p.field.name for p in (stamp, count, pos, state, some)] == ["stamp", "count", "Pos [deg]", "state", "some"]
    assert stamp.largest - stamp.least == N - 1
    assert (count.samples, count.first, count.least, count.largest) == (N, (0, 1, 2, 3), 0, N - 1)
    assert (pos.least, pos.largest) == (-(N - 1) / 2, 0)
    assert (state.samples, state.first, state.outline) == (0, (), ())
    assert (some.first, some.least) == ((1, 2, 3, 4), 1)


def test_a_picture_has_every_peak(tmp_path):
    """Each part has its least and largest value, however long the file is."""
    q = np.zeros(5000)
    q[1234], q[4321] = 7.0, -3.0
    np.savez(tmp_path / "log.npz", t=np.arange(5000) / 1000, q=q)
    found = {p.field.name: p for p in previews(opened(tmp_path / "log.npz", Refusal("log.npz")))}
    outline = found["q"].outline
    assert max(high for _, high in outline) == 7
    assert min(low for low, _ in outline) == -3
    assert sum(high > 0 for _, high in outline) == sum(low < 0 for low, _ in outline) == 1
    assert found["t"].outline[0][0] == 0
    assert found["t"].outline[-1][1] == pytest.approx(4.999)

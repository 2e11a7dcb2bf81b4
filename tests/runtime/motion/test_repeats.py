"""Motion that comes back between the rows of a narrow band: it is found, and what comes back is told from noise."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from runtime.model.loader import Model
from runtime.motion import repeats
from runtime.motion.band import Band
from runtime.motion.motion import prepare
from runtime.recordings.recording import Recording

DT = 1e-3
CUTOFF = 14.0  # Hz: rows are 28 samples apart


@pytest.mark.parametrize(("period", "once"), [(3000, False), (3008, False), (3014, False), (3008, True)])
def test_what_comes_back_between_rows_is_told_from_noise(drive: Model, period: int, once: bool) -> None:
    """Three times the same three seconds, a cycle being no whole number of rows; the rest of the motion is another.
    What comes back lasts, or is felt once a cycle, as a stop is that is touched there."""
    rng, count = np.random.default_rng(period), 3 * period
    t = np.arange(count) * DT
    base = 2 * np.pi / (period * DT)
    wave = sum(rng.normal() / k * np.sin(k * base * t + rng.uniform(0, 6)) for k in range(1, 7))
    other = np.arange(8000) * DT
    q = np.concatenate([0.4 * np.sin(1.7 * other) * np.minimum(other, 1.0), 0.3 * wave])
    width, cycle = 0.08, period * DT  # s
    touched = 0.4 * np.exp(-(((t % cycle - cycle / 2) / width) ** 2))
    back = np.concatenate([np.zeros(8000), touched if once else 0.1 * np.sin(9 * base * t)])
    size = 0.4 * np.sqrt(width * np.sqrt(np.pi / 2) / cycle) if once else 0.1 / np.sqrt(2)
    tau = 0.2365 * np.gradient(np.gradient(q, DT), DT)
    whole, at = np.zeros(len(q), dtype=np.int64), np.arange(len(q)) * DT
    recording = Recording(Path("run.csv"), at, whole, q[None], tau[None], ("revolute",), (slice(0, len(q)),), (None,))
    silent = np.array([2 * DT * 0.2**2])
    motion = prepare([recording], Band(CUTOFF * np.ones(1), "given", silent, 1e-14 * silent, np.zeros(1)), drive)
    (found,) = repeats.find(motion)
    assert len(found.pairs) >= 2
    piece = motion.pieces[0]
    inner = slice(piece.derive.half, len(q) - piece.derive.half)
    residual = piece.in_band(0.2 * rng.standard_normal(len(piece.t)) + back[inner])
    parts = found.pure_error(residual, np.ones(len(residual), dtype=bool))
    assert parts is not None
    noise, coming_back = parts
    assert noise == pytest.approx(0.2 * np.sqrt(2 * DT * CUTOFF), rel=0.2)
    assert coming_back == pytest.approx(size, rel=0.25)

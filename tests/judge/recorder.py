"""What a logger makes of what a plant did: its instants, its stamps, its means, its steps of a torque, its rates.

The drives run at PERIOD. A logger takes every so many of their periods; its torque is the drives' command over at most
HELD of them from the sample on, short against any motion, and its other signals are those of the instant. The torque's
noise is a mean over a whole nominal step, and so as dense at any rate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from runtime.arrays import Array
from runtime.recordings.recording import Recording

from .plant import COUNT, PERIOD, Run

Index = NDArray[np.intp]

LONG = 1.2  # a long step over a short one, of a logger that has two
LOST = 0.004  # part of the samples
CLOCK = (1e-3, 4e-3)  # by how much a clock that is read in whole ms is off the drives', at least and at most
HELD = 2  # periods
READ_IN = 1e-3  # s, the stamps' last digit of a logger that rounds them
RATE_NOISE = 2e-4  # rad/s, of a rate that is measured well
RATE_CORNER = 25.0  # Hz, of a drive's filter of second order over differences
STAMPS = ("even", "two_steps", "rounded", "lost")
RATES = ("", "clean", "filtered", "difference")


@dataclass(frozen=True)
class Logger:
    """How signals are written down.

    every       periods of the drives a step
    stamps      of STAMPS: even; steps of 1 or LONG at random; rounded to READ_IN by another clock; single samples lost
    resolution  N m, of the torque; 0: as fine as numbers are
    rates       of RATES: no rate; nearly the true one; a filtered one, late; the difference of two positions
    link_late   s by which an encoder at the link is read later than the motor's; None: there is none
    """

    every: int = 1
    stamps: str = "even"
    resolution: float = 0.0
    rates: str = ""
    link_late: float | None = None

    def __str__(self) -> str:
        """What is not as it is by default, in a few words."""
        parts = [f"/{self.every}"] if self.every > 1 else []
        parts += [self.stamps] if self.stamps != "even" else []
        parts += [f"steps {self.resolution:g}"] if self.resolution else []
        parts += [f"qd {self.rates}"] if self.rates else []
        parts += [] if self.link_late is None else [f"link {1e3 * self.link_late:g} ms late"]
        return " ".join(parts)


def instants(logger: Logger, count: int, rng: np.random.Generator) -> Index:
    """The drives' periods, of `count`, at whose beginnings samples are taken."""
    if logger.stamps == "two_steps":
        steps = np.where(rng.random(count // logger.every) < 0.5, logger.every, round(LONG * logger.every))
        at = np.concatenate([[0], np.cumsum(steps)])
        return np.asarray(at[at < count - logger.every], dtype=np.intp)
    at = np.arange(0, count - logger.every + 1, logger.every)
    if logger.stamps == "lost":
        lost = rng.random(len(at)) < LOST
        lost[1:] &= ~lost[:-1]  # single ones
        return at[~lost]
    return at


def clock(logger: Logger, rng: np.random.Generator) -> float:
    """How much longer a period of the drives is than the clock of the stamps has it, as a factor."""
    return 1.0 + float(rng.choice([-1.0, 1.0]) * rng.uniform(*CLOCK)) if logger.stamps == "rounded" else 1.0


def stamped(logger: Logger, t: Array) -> Array:
    """s, what is written for the instants t."""
    return np.asarray(np.round(t / READ_IN) * READ_IN) if logger.stamps == "rounded" else t


def held(logger: Logger) -> int:
    """Periods over which a command is taken."""
    return min(logger.every, HELD)


def means(x: Array, at: Index, periods: int) -> Array:
    """(..., M) means of x (..., N) over so many periods from each of the instants on."""
    if periods == 1:
        return x[..., at]
    total = np.concatenate([np.zeros((*x.shape[:-1], 1)), np.cumsum(x, axis=-1)], axis=-1)
    found: Array = (total[..., at + periods] - total[..., at]) / periods
    return found


def steps(x: Array, step: float) -> Array:
    """x in whole steps; as it is, for a step of 0."""
    return np.asarray(np.round(x / step) * step) if step else x


def record(
    logger: Logger, run: Run, t: Array, at: Index, noise: Array, coarse: float, warmth: Sequence[Array | None]
) -> Recording:
    """What the logger writes of a run.

    t       (N,) s, the drives' instants; at (M,) those that are logged
    noise   (n, N) N m of the torque
    coarse  encoder counts, as multiples of COUNT
    warmth  (N,) °C a joint, or None
    """
    written = stamped(logger, t[at])
    q = steps(run.q[:, at], COUNT * coarse)
    tau = means(run.tau, at, held(logger)) + means(noise, at, logger.every)
    link = None
    if logger.link_late is not None:
        late = t[at] + logger.link_late
        link = steps(np.array([np.interp(late, t, row) for row in run.link]), COUNT)
    return Recording(
        path=Path("judge.csv"),
        t=written,
        run=np.zeros(len(written), dtype=np.int64),
        q=np.ascontiguousarray(q),
        tau=np.ascontiguousarray(steps(tau, logger.resolution)),
        types=("revolute",) * len(q),
        segments=(slice(0, len(written)),),
        temperature=tuple(None if row is None else row[at] for row in warmth),
        qd=_rates(logger, run, at, written, q, coarse),
        q_link=link,
    )


def _rates(logger: Logger, run: Run, at: Index, written: Array, q: Array, coarse: float) -> Array | None:
    """(n, M) rad/s that is logged beside the positions."""
    if logger.rates == "clean":
        before = np.concatenate([run.rate[:, :1], run.rate[:, :-1]], axis=1)
        at_samples: Array = 0.5 * (before + run.rate)[:, at]
        return at_samples + RATE_NOISE * np.random.default_rng(len(at)).standard_normal(at_samples.shape)
    if logger.rates == "filtered":
        fine = steps(run.q, COUNT * coarse)
        difference = np.diff(fine, axis=1, prepend=fine[:, :1]) / PERIOD
        filtered = signal.sosfilt(signal.butter(2, RATE_CORNER, fs=1 / PERIOD, output="sos"), difference, axis=1)
        return np.ascontiguousarray(filtered[:, at])
    if logger.rates == "difference":
        return np.ascontiguousarray(np.diff(q, axis=1, prepend=q[:, :1]) / np.diff(written, prepend=written[0] - 1.0))
    return None

"""The model's motion under what drove the recorded one: many windows of a recording side by side.

In open loop the recorded torque acts. In closed loop a joint's controller answers to the model's motion. With stated
gains it adds k_p (q_recorded − q) + k_d (qd_recorded − qd) to the recorded torque: what a controller with these gains
and any feedforward would have commanded. A drive with a law makes its torque of the recorded command and the model's
motion.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from runtime.arrays import Array
from runtime.model.batch import Batch
from runtime.model.loader import Model
from runtime.recordings.driven import DrivenJoint
from runtime.replay.track import Track, read_by
from runtime.simulation.equations import PlantEquations
from runtime.simulation.integrator import Integrator, runge_kutta
from symbolic.model_file.drive_laws import INTEGRAL

Gain = Mapping[str, Any]
"""Coefficients of a drive's law by name, numbers or expressions."""


@dataclass(frozen=True)
class Feedback:
    """What makes a joint's torque in closed loop: its drive's law, or gains beside the recorded torque, N m/rad and
    N m s/rad (N/m and N s/m); delay: s after which a controller's answer acts."""

    drive: DrivenJoint | None
    kp: float = 0.0
    kd: float = 0.0
    delay: float = 0.0

    @property
    def reads(self) -> list[str]:
        """What it reads of a track."""
        own = ["tau", "qd"] if self.drive is None else read_by(self.drive)
        return [*own, "q", "residual"]

    def torque(self, read: Mapping[str, Any], q: Any, qd: Any, lagging: Any, gains: Gain) -> Any:
        """Of what it reads and the model's motion; lagging: the integral of the recorded less the model's position."""
        if self.drive is None:
            return read["tau"] - read["residual"] + self.kp * (read["q"] - q) + self.kd * (read["qd"] - qd)
        signals = {**read, "q": q, "qd": qd}
        if INTEGRAL in signals:
            signals[INTEGRAL] = read[INTEGRAL] + lagging
        law, own = self.drive.law, self.drive.gains
        columns = law.columns(signals, own, _ramp)
        made = sum(gains[term.name] * x for term, x in zip(law.terms, columns, strict=True))
        return law.limited(made, own, _ramp) - read["residual"]


def _ramp(x: Any) -> Any:
    return ca.fmax(x, 0)


OPEN_LOOP = Feedback(None)
"""The recorded torque alone."""


@dataclass(frozen=True)
class Windows:
    """Starts of windows of `length` samples: the number of the track and the first sample of each."""

    length: int
    starts: tuple[tuple[int, int], ...]

    @classmethod
    def of(cls, tracks: Sequence[Track], length: int) -> Windows:
        """One after the other in every track that is long enough."""
        starts = [(k, s) for k, track in enumerate(tracks) for s in range(0, len(track.t) - length, length)]
        return cls(length, tuple(starts))

    def cut(self, tracks: Sequence[Track], name: str) -> Array:
        """(W, length + 1, n) of a signal (n, N) of the tracks."""
        parts = [getattr(tracks[k], name)[:, s : s + self.length + 1].T for k, s in self.starts]
        return np.array(parts)


@dataclass(frozen=True, eq=False)
class DrivenArm:
    """An arm whose joints' torques are made by `feedback`, in steps of the integrator.

    coefficients   of the drives' laws by joint (0-based) and name, numbers or expressions
    equations      those of the integrator, or the same with other parameters
    free           (k,) the symbols among parameters and coefficients
    """

    model: Model
    made: Integrator
    feedback: tuple[Feedback, ...]
    coefficients: Mapping[int, Gain]
    equations: PlantEquations
    free: Any = field(default_factory=lambda: ca.SX(0, 1))

    @cached_property
    def step(self) -> ca.Function:
        """The state after a step, of the state, what is read (r,), and the symbols of the parameters.

        A state is that of the integrator, and for every joint the integral of the recorded less the model's position,
        and the acceleration.
        """
        n, h = self.model.n, self.made.step
        one = runge_kutta(self.equations, h)
        whole = ca.SX.sym("state", one.size1_in(0) + 2 * n)
        own, lagging, qdd = whole[: -2 * n], whole[-2 * n : -n], whole[-n:]
        names = [(i, name) for i, each in enumerate(self.feedback) for name in each.reads]
        symbols = ca.SX.sym("read", len(names))
        read: list[dict[str, Any]] = [{} for _ in range(n)]
        for k, (i, name) in enumerate(names):
            read[i][name] = symbols[k]
        q, qd = own[:n], own[n : 2 * n]
        torques = []
        for i, each in enumerate(self.feedback):
            # Commands are those of the middle of a step; an answer is to the motion of some time before.
            ahead = h / 2 - each.delay
            seen = q[i] + ahead * qd[i] + ahead**2 / 2 * qdd[i], qd[i] + ahead * qdd[i]
            torques.append(each.torque(read[i], *seen, lagging[i], self.coefficients.get(i, {})))
        further = [lagging[i] + h * (read[i]["q"] - q[i]) for i in range(n)]
        moved = one(own, ca.vertcat(*torques), self.equations.free)
        after = ca.vertcat(moved, *further, (moved[n : 2 * n] - qd) / h)
        return ca.Function("driven", [whole, symbols, self.free], [ca.cse(after)])

    def starts(self, tracks: Sequence[Track], windows: Windows) -> Array:
        """(W, S) states of the recorded motion at the beginning of every window."""
        return np.array(
            [
                np.concatenate(
                    [
                        tracks[k].q[:, s],
                        tracks[k].qd[:, s],
                        tracks[k].states[:, s],
                        tracks[k].tau[:, s],
                        [tracks[k].t[s]],
                        np.zeros(2 * self.model.n),
                    ]
                )
                for k, s in windows.starts
            ]
        )

    def read(self, tracks: Sequence[Track], windows: Windows, without: float = 0.0) -> Array:
        """(length, substeps, W, r) what is read in the middle of every step along every window.

        without   the part of the torque that the model does not explain that is taken out
        """
        each = []
        for i, feedback in enumerate(self.feedback):
            for name in feedback.reads:
                rows = [_row(track, i, name, without) for track in tracks]
                held = [track.late if (i, name) in track.commands else None for track in tracks]
                each.append([self._middles(rows[k], s, windows.length, held[k]) for k, s in windows.starts])
        return np.ascontiguousarray(np.array(each).transpose(2, 3, 1, 0))

    def _middles(self, row: Array, start: int, length: int, held: float | None) -> Array:
        """(length, substeps) of a row of samples (N,) from one on: a cubic of the four around, as a torque and a motion
        go on smoothly between them; of a command, which is held from so many samples after its own, the mean over a
        step. Source: Catmull & Rom 1974."""
        substeps = self.made.substeps
        whole = 0 if held is None else int(np.floor(held))
        places = np.arange(start - 1 - whole, start + length + 2 - whole)
        around = sliding_window_view(row[np.clip(places, 0, len(row) - 1)], 4)
        x = (np.arange(substeps) + 0.5) / substeps
        weights = (
            (-x + 2 * x**2 - x**3) / 2,
            1 - 2.5 * x**2 + 1.5 * x**3,
            (x + 4 * x**2 - 3 * x**3) / 2,
            (x**3 - x**2) / 2,
        )
        if held is not None:
            # The part of a step that lies before the next command acts.
            before = np.clip((held - whole - x) * substeps + 0.5, 0.0, 1.0)
            weights = before, 1 - before, 0 * x, 0 * x
        return np.asarray(around[:length] @ np.stack(weights))

    @cached_property
    def slope(self) -> ca.Function:
        """The state after a step and its derivative in a direction: of the state, what is read, the parameters, and the
        direction of state and parameters."""
        state, read = (ca.SX.sym(name, self.step.size1_in(k)) for k, name in enumerate(("state", "read")))
        both = ca.vertcat(state, self.free)
        toward = ca.SX.sym("toward", both.size1())
        after = self.step(state, read, self.free)
        further = ca.jtimes(after, both, toward)
        inputs = [state, read, self.free, toward[: state.size1()], toward[state.size1() :]]
        return ca.Function("slope", inputs, [after, further])

    def slopes(self, start: Array, read: Array, free: Array, toward: Array, toward_free: Array) -> tuple[Array, Array]:
        """Positions (W, length + 1, n) as `play`, and their derivatives (W, D, length + 1, n) in D directions, toward
        (D, S) of the state at the start and toward_free (D, k) of the parameters."""
        count, many, n = len(start), len(toward), self.model.n
        batch = Batch(self.slope, count * many)
        state, moved = np.repeat(start, many, axis=0), np.tile(toward, (count, 1))
        directions = np.tile(toward_free, (count, 1))
        positions, derivatives = np.empty((len(read) + 1, count, n)), np.empty((len(read) + 1, count * many, n))
        positions[0], derivatives[0] = start[:, :n], moved[:, :n]
        with np.errstate(all="ignore"):  # a motion that runs away
            for k, middles in enumerate(read, 1):
                for now in middles:
                    after = batch(state, np.repeat(now, many, axis=0), free, moved, directions)
                    state[:], moved[:] = after[0][:, 0], after[1][:, 0]
                positions[k], derivatives[k] = state[::many, :n], moved[:, :n]
        return positions.transpose(1, 0, 2), derivatives.reshape(-1, count, many, n).transpose(1, 2, 0, 3)

    def play(self, start: Array, read: Array, free: Sequence[float] | Array = ()) -> Array:
        """(W, length + 1, n) positions from states (W, S) under what is read (length, substeps, W, r)."""
        count, n = len(start), self.model.n
        batch = Batch(self.step, count)
        state, own = start.copy(), np.array(free)
        found = np.empty((len(read) + 1, count, n))
        found[0] = state[:, :n]
        with np.errstate(all="ignore"):  # a motion that runs away
            for k, middles in enumerate(read, 1):
                for now in middles:
                    state[:] = batch(state, now, own)[0][:, 0]
                found[k] = state[:, :n]
        return found.transpose(1, 0, 2)


def _row(track: Track, i: int, name: str, without: float) -> Array:
    if name == "residual":
        return without * track.residual[i]
    return getattr(track, name)[i] if name in ("q", "qd", "tau") else track.commands[i, name]

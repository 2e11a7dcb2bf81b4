"""The model's motion under what drove the recorded one: many windows of a recording side by side.

In open loop the recorded torque acts. In closed loop a joint's controller answers to the model's motion. With stated
gains it adds k_p (q_recorded − q) + k_d (qd_recorded − qd) to the recorded torque: what a controller with these gains
and any feedforward would have commanded. A drive with a law makes its torque of the recorded command and the model's
motion.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from runtime.model.loader import Model
from runtime.planning.blocks import Batch, Instructions, Machine
from runtime.recordings.driven import DrivenJoint
from runtime.replay.track import Track, read_by
from runtime.simulation.equations import PlantEquations
from runtime.simulation.integrator import Integrator, runge_kutta
from symbolic.model_file.drive_laws import INTEGRAL

Array = NDArray[np.float64]
Gain = Mapping[str, Any]
"""Coefficients of a drive's law by name, numbers or expressions."""


@dataclass(frozen=True)
class Feedback:
    """What makes a joint's torque in closed loop: its drive's law, or gains beside the recorded torque, N m/rad and
    N m s/rad (N/m and N s/m)."""

    drive: DrivenJoint | None
    kp: float = 0.0
    kd: float = 0.0

    @property
    def reads(self) -> list[str]:
        """What it reads of a track."""
        return ["tau", "q", "qd"] if self.drive is None else [*read_by(self.drive), "q"]

    def torque(self, read: Mapping[str, Any], q: Any, qd: Any, lagging: Any, gains: Gain) -> Any:
        """Of what it reads and the model's motion; lagging: the integral of the recorded less the model's position."""
        if self.drive is None:
            return read["tau"] + self.kp * (read["q"] - q) + self.kd * (read["qd"] - qd)
        signals = {**read, "q": q, "qd": qd}
        if INTEGRAL in signals:
            signals[INTEGRAL] = read[INTEGRAL] + lagging
        law, own = self.drive.law, self.drive.gains
        columns = law.columns(signals, own, _ramp)
        made = sum(gains[term.name] * x for term, x in zip(law.terms, columns, strict=True))
        return law.limited(made, own, _ramp)


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
    """

    model: Model
    made: Integrator
    feedback: tuple[Feedback, ...]
    coefficients: Mapping[int, Gain]
    equations: PlantEquations

    @cached_property
    def step(self) -> ca.Function:
        """The state after a step, of the state, what is read (r,), and the symbols of the parameters.

        A state is that of the integrator, and for every joint the integral of the recorded less the model's position.
        """
        n, h = self.model.n, self.made.step
        one = runge_kutta(self.equations, h)
        whole = ca.SX.sym("state", one.size1_in(0) + n)
        own, lagging = whole[:-n], whole[-n:]
        names = [(i, name) for i, each in enumerate(self.feedback) for name in each.reads]
        symbols = ca.SX.sym("read", len(names))
        read: list[dict[str, Any]] = [{} for _ in range(n)]
        for k, (i, name) in enumerate(names):
            read[i][name] = symbols[k]
        # Commands are those of the middle of a step, and so is the position.
        q, qd = own[:n] + h / 2 * own[n : 2 * n], own[n : 2 * n]
        torques = [
            each.torque(read[i], q[i], qd[i], lagging[i], self.coefficients.get(i, {}))
            for i, each in enumerate(self.feedback)
        ]
        further = [lagging[i] + h * (read[i]["q"] - q[i]) for i in range(n)]
        after = ca.vertcat(one(own, ca.vertcat(*torques), self.equations.free), *further)
        free = self.free
        return ca.Function("driven", [whole, symbols, free], [ca.cse(after)])

    @cached_property
    def free(self) -> Any:
        """The symbols among the parameters and the drives' coefficients, (k,)."""
        gains = [c for own in self.coefficients.values() for c in own.values()]
        return ca.vertcat(*ca.symvar(ca.SX(ca.vertcat(self.equations.free, *gains))))

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
                        np.zeros(self.model.n),
                    ]
                )
                for k, s in windows.starts
            ]
        )

    def read(self, tracks: Sequence[Track], windows: Windows, without: float = 0.0) -> Array:
        """(length + 1, W, r) what is read along every window. without: the part of the unexplained torque that is taken
        out of the recorded one."""
        each = []
        for i, feedback in enumerate(self.feedback):
            for name in feedback.reads:
                rows = [_row(track, i, name, without) for track in tracks]
                each.append([rows[k][s : s + windows.length + 1] for k, s in windows.starts])
        return np.ascontiguousarray(np.array(each).transpose(2, 1, 0))

    def play(self, start: Array, read: Array, free: Sequence[float] = ()) -> Array:
        """(W, length + 1, n) positions from states (W, S) under what is read (length + 1, W, r)."""
        count, n = len(start), self.model.n
        batch = Batch(Machine(self.model.library.machine), Instructions.of(self.step), count)
        state, own = start.copy(), np.array(free)
        found = np.empty((len(read), count, n))
        found[0] = state[:, :n]
        parts = (np.arange(self.made.substeps) + 0.5) / self.made.substeps
        with np.errstate(all="ignore"):  # a motion that runs away
            for k in range(1, len(read)):
                for part in parts:
                    state[:] = batch(state, (1 - part) * read[k - 1] + part * read[k], own)[0][:, 0]
                found[k] = state[:, :n]
        return found.transpose(1, 0, 2)


def _row(track: Track, i: int, name: str, without: float) -> Array:
    if name == "tau":
        return track.tau[i] - without * track.residual[i]
    return getattr(track, name)[i] if name in ("q", "qd") else track.commands[i, name]

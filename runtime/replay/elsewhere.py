"""A replay in MuJoCo: the windows of a replay, played from the file that export writes, beside Tendon's equations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Self

import numpy as np

from runtime.arrays import Array
from runtime.documents.replays import MotionErrorEntry
from runtime.exchange.mujoco_play import Played
from runtime.recordings.recording import RecordingError
from runtime.replay.driven_arm import Windows
from runtime.replay.replay import PlayedWindows, Replay
from runtime.replay.track import remembering
from symbolic.model_file.arm import COMMAND, MOTOR_TORQUE


@dataclass(frozen=True, eq=False)
class MujocoReplay(Replay):
    """A replay whose windows in open loop MuJoCo plays.

    player   the exported file     own   the same replay with Tendon's equations
    """

    player: Played | None = None
    own: Replay | None = None

    @classmethod
    def beside(cls, own: Replay, player: Played) -> Self:
        """The same recordings. Raises RecordingError where MuJoCo has no such torque."""
        if own.motion.pieces[0].torque not in (MOTOR_TORQUE, COMMAND):
            raise RecordingError(
                f"{own.recordings[0].path}: its torque is not the motors', which drive the arm in MuJoCo; expected a "
                "recording of motor torques or commands"
            )
        return cls(**{f.name: getattr(own, f.name) for f in fields(Replay)}, player=player, own=own)

    @cached_property
    def closed_loop(self) -> PlayedWindows | None:
        """None: controllers are not part of the exported file."""
        return None

    def _under_torque(self, windows: Windows) -> PlayedWindows:
        assert self.player is not None
        cut = {name: windows.cut(self.tracks, name) for name in ("q", "qd", "tau")}
        t: Array = self.tracks[0].dt * np.arange(windows.length + 1, dtype=np.float64)
        played = self.player.windows(
            t, cut["tau"], cut["q"][:, 0], cut["qd"][:, 0], self._bent(windows), self._rests(windows)
        )
        return PlayedWindows(windows, self.tracks[0].dt, cut["q"], played, np.full_like(played, np.nan))

    def _rests(self, windows: Windows) -> Array:
        return np.array([self._along[k][s] for k, s in windows.starts])

    @cached_property
    def _along(self) -> list[Array]:
        assert self.player is not None
        return [self.player.rests(track.q.T) for track in self.tracks]

    def _bent(self, windows: Windows) -> Array:
        """(W, 2, n) how far the motors are ahead of their links where windows begin, and at which rate."""
        states, library = windows.cut(self.tracks, "states"), self.model.library
        bent, place = np.zeros((len(windows.starts), 2, self.model.n)), 0
        for term in remembering(self.model, self.known):
            effect = library.effects[term.effect]
            if effect.deflection is not None:
                now, later = states[:, :2, place + effect.states.index(effect.deflection)].T
                bent[:, :, (term.joint or 1) - 1] = np.stack([now, (later - now) / self.tracks[0].dt], axis=1)
            place += len(effect.states)
        return bent

    def _agreement(self, i: int, errors: Sequence[MotionErrorEntry]) -> tuple[bool | None, str]:
        assert self.own is not None
        own = self.own.joints[i]
        return own.agrees, f"by Tendon's equations, {own.reason}" if errors else own.reason

    def _error(self, k: int, joint: int) -> MotionErrorEntry:
        assert self.own is not None
        return self.opened[k].error(joint, beside=self.own.opened[k])

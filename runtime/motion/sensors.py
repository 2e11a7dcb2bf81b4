"""What a recording has beside motor angles and torques: link-side encoders, torque sensors, forces, demanded angles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from runtime.motion.clock import Stretch
from runtime.motion.filters import Differentiator
from runtime.recordings.recording import Recording

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_NAMES = ("q_link", "q_desired", "tau_link", "tau_rigid", "force")


@dataclass(frozen=True)
class Sensors:
    """Measured over the samples of a piece; None where not.

    twist         (n, N) rad, motor less link, smoothed as the position is; NaN for a joint without link-side encoder
    twist_qdd     its second derivative
    tau_link      (n, N) N m at the joints' output; NaN for a joint without torque sensor
    tau_rigid     (n, N) N m, the rigid-body torque of the user's own model
    force         (2, N) N on the end-effector along base x and y, in space (6, N) N and N m along and about x, y and z;
                  a component that is not measured is zero
    q_desired     (n, N) rad (m) that were demanded; NaN for a joint of which it is not known
    """

    twist: Array | None = None
    twist_qdd: Array | None = None
    tau_link: Array | None = None
    tau_rigid: Array | None = None
    force: Array | None = None
    q_desired: Array | None = None

    def has(self, name: str, joint: int) -> bool:
        """Whether twist, tau_link or tau_rigid is measured at a joint (0-based)."""
        rows: Array | None = getattr(self, name)
        return rows is not None and not bool(np.isnan(rows[joint, 0]))

    def cut(self, window: slice) -> Sensors:
        """Those within a window of the samples."""
        parts = {f.name: getattr(self, f.name) for f in fields(self)}
        return Sensors(**{k: None if x is None else np.ascontiguousarray(x[:, window]) for k, x in parts.items()})

    def moved(self, q: Array, qdd: Array) -> Sensors:
        """The same with other errors of the motors' encoders: q and qdd (n, N) are added to their angles."""
        if self.twist is None or self.twist_qdd is None:
            return self
        return replace(self, twist=self.twist + q, twist_qdd=self.twist_qdd + qdd)

    def aligned(self, t: Array, q: Array, qdd: Array, late: Array) -> Sensors:
        """The same with the link-side encoders read `late` (n,) s sooner, 0 where there is none: at the instants t (N,)
        of the motors' angles q and their accelerations qdd (n, N)."""
        if self.twist is None or self.twist_qdd is None or not late.any():
            return self
        from scipy.interpolate import make_interp_spline  # where it is used: it takes longer to load than a fit

        twist, curvature = self.twist.copy(), self.twist_qdd.copy()
        for i in np.flatnonzero(late):
            there = np.clip(t + late[i], t[0], t[-1])
            link = make_interp_spline(t, np.array([q[i] - twist[i], qdd[i] - curvature[i]]), k=3, axis=1)(there)
            twist[i], curvature[i] = q[i] - link[0], qdd[i] - link[1]
        return replace(self, twist=twist, twist_qdd=curvature)


NOTHING = Sensors()


def measured_in_all(recordings: Sequence[Recording]) -> dict[str, Mask]:
    """Of each signal, (n,) whether all recordings have it, by joint (by component for the force)."""
    found = {}
    for name in _NAMES:
        rows = [getattr(r, name) for r in recordings]
        none = any(x is None for x in rows)
        found[name] = np.zeros(1, dtype=bool) if none else np.all([~np.isnan(x).all(axis=1) for x in rows], axis=0)
    return found


def read(recording: Recording, stretch: Stretch, derive: Differentiator, common: Mapping[str, Mask]) -> Sensors:
    """The signals that all recordings have, over the places that the smoothed position has."""

    def raw(name: str, absent: float = np.nan) -> Array | None:
        if not common[name].any():
            return None
        rows = stretch.of(getattr(recording, name)[:, stretch.samples])[:, derive.half : -derive.half]
        return np.where(common[name][:, None], rows, absent)

    rigid = raw("tau_rigid") if common["tau_rigid"].all() else None
    found = Sensors(None, None, raw("tau_link"), tau_rigid=rigid, force=raw("force", 0.0), q_desired=raw("q_desired"))
    if recording.q_link is None or not common["q_link"].any():
        return found
    between = (recording.q - recording.q_link)[common["q_link"], stretch.samples]
    parts = [derive(row) for row in stretch.of(between)]
    twist = np.full((len(recording.q), len(parts[0][0])), np.nan)
    curvature = twist.copy()
    twist[common["q_link"]], curvature[common["q_link"]] = [p[0] for p in parts], [p[2] for p in parts]
    return replace(found, twist=twist, twist_qdd=curvature)

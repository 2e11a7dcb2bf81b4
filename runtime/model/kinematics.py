"""The frames of an arm's joints on NumPy arrays, from the poses and axes of its model file, without compiled code."""

from __future__ import annotations

import numpy as np

from runtime.arrays import Array
from symbolic.model_file.arm import Arm, Frame, Joint
from symbolic.model_file.frames import rotation


def unit_axis(joint: Joint) -> Array:
    """(3,) unit vector along the joint's axis, in its own frame."""
    axis = np.array(joint.axis)
    return axis / np.linalg.norm(axis)


def pose(frame: Frame) -> tuple[Array, Array]:
    """Rotation (3, 3) and origin (3,) m of a frame in the one before."""
    return np.array(rotation(frame.rpy)), np.array(frame.xyz)


def in_frame_before(joint: Joint, q: Array) -> tuple[Array, Array]:
    """Rotation (3, 3, N) and origin (3, N) m of a joint's own frame at q (N,) in the frame before."""
    (R, p), axis = pose(joint.origin), unit_axis(joint)
    if joint.type == "prismatic":
        return np.repeat(R[:, :, None], len(q), axis=2), p[:, None] + (R @ axis)[:, None] * q
    # Rodrigues: exp(q [a]) = a aᵀ + cos q (1 - a aᵀ) + sin q [a].
    along, across = np.outer(axis, axis), np.cross(axis, np.eye(3)).T
    parts = (R @ part for part in (along, np.eye(3) - along, across))
    still, cosine, sine = (part[:, :, None] for part in parts)
    return still + cosine * np.cos(q) + sine * np.sin(q), np.repeat(p[:, None], len(q), axis=1)


def body_frames(arm: Arm, q: Array) -> tuple[Array, Array]:
    """Rotations (n + 1, 3, 3, N) and origins (n + 1, 3, N) m of the base's and the joints' frames at q (n, N), in the
    base frame."""
    n, N = q.shape
    R, p = np.empty((n + 1, 3, 3, N)), np.zeros((n + 1, 3, N))
    R[0] = np.eye(3)[:, :, None]
    for k, joint in enumerate(arm.joints):
        turned, moved = in_frame_before(joint, q[k])
        R[k + 1] = np.einsum("abN,bcN->acN", R[k], turned)
        p[k + 1] = p[k] + np.einsum("abN,bN->aN", R[k], moved)
    return R, p

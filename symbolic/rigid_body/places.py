"""Where the joints of an arm are when all positions are 0: what a picture of it needs beside its tip's functions."""

from __future__ import annotations

from itertools import accumulate

from symbolic.model_file.arm import Arm
from symbolic.rigid_body.spatial.frames import file_frames

Place = tuple[float, ...]


def places(arm: Arm) -> tuple[Place, ...]:
    """(n,) of the joints, each (2,) or in space (3,) m in base axes; of a slide where it begins."""
    if arm.space:
        return tuple(tuple(map(float, frame.at)) for frame in file_frames(arm))
    return tuple((float(x), 0.0) for x in accumulate(arm.lengths[:-1], initial=0.0))

"""Whether a torque on the rate of two joints at once shows at both of them, in the proportion that its motor has.

Where the rates of two joints are alike, or one joint's friction has another law than the model's, a torque on their sum
explains what one joint lacks, and its columns at the other say nothing. What is common to both must show at either.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace

import numpy as np

from runtime.diagnosis.gates import BOTH_JOINTS, EACH_SHARE, PROPORTION, GateResult
from runtime.regression.rows import Block
from runtime.regression.system import LinearSystem


def results(
    plain: LinearSystem, white: LinearSystem, block: Block, white_block: Block, floors: Sequence[float]
) -> Iterator[GateResult]:
    """What the gates say of a block at two joints.

    plain    without the block, and floors N m (N), the noise floor of every joint
    white    the same whitened, with what explains most at each of the joints alone
    """
    before, after = plain.solution.residual, plain.with_block(block).solution.residual
    shares = []
    for joint in block.columns:
        was, now = (float(left[joint] @ left[joint]) for left in (before, after))
        excess = was - plain.joints[joint].count * floors[joint] ** 2
        shares.append((was - now) / max(excess, was - now, 1e-300))
    yield EACH_SHARE.asked(min(shares))
    tied = white.with_block(white_block).solution
    least = min(white.with_block(_at(white_block, {joint})).solution.sse for joint in block.columns)
    yield BOTH_JOINTS.asked(0.5 * white.count * float(np.log(max(least, 1e-300) / max(tied.sse, 1e-300))))
    apart = white
    for joint in block.columns:
        apart = apart.with_block(_at(white_block, {joint}))
    fall = white.solution.sse - apart.solution.sse
    yield PROPORTION.asked((tied.sse - apart.solution.sse) / fall if fall > 0 else 1.0)


def _at(block: Block, joints: Collection[int]) -> Block:
    """What a block has at some of its joints (0-based), with coefficients of its own."""
    columns = {joint: part for joint, part in block.columns.items() if joint in joints}
    return replace(block, key=(block.key, *joints), columns=columns)

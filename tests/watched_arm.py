"""An arm whose model is watched on the board, as a person writes it."""

from __future__ import annotations

from tests.bench_arm import CONTROLLER, JOINT
from tests.one_joint import joint_text

MONITOR = """\
[monitor]
cutoff = 8.0
"""


def watch_text(floor: float, load_floor: float = 0.0) -> str:
    """What a joint's residual is compared with."""
    return f"[joint.monitor]\nfloor = {floor}\nload_floor = {load_floor}\nslowest = 0.02\n"


def watched_text(
    joints: int = 1, floor: float = 0.08, monitor: str = MONITOR, tables: str = "", load_floor: float = 0.0
) -> str:
    """The file of an arm in the plane, all joints alike; tables: of each joint besides."""
    one = joint_text(JOINT + watch_text(floor, load_floor) + tables)
    head = f'name = "arm"\ngravity = [0.0, 0.0]\n{CONTROLLER}{monitor}'
    return head + one * joints

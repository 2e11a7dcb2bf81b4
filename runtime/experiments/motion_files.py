"""Motions in the formats of other programs: CSV, ROS 2 (YAML and MCAP), URScript, LeRobot."""

from __future__ import annotations

import gzip
import json
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from struct import pack

import numpy as np

from runtime.arrays import Array
from runtime.experiments.asking import ExperimentError
from runtime.experiments.options import UNITS, MotionOptions
from runtime.experiments.settings import AT_START, NORMALISED, STOPPING
from runtime.model.loader import Model
from symbolic.model_file.checks import printable


@dataclass(frozen=True)
class SampledMotion:
    """A motion in even steps.

    names    of the joints               t           (N,) s from 0 on
    q, qd, qdd   (n, N) rad (m), and per s, s^2      notes   lines of comment
    """

    model: Model
    names: Sequence[str]
    t: Array
    q: Array
    qd: Array
    qdd: Array
    notes: Sequence[str]

    @property
    def comments(self) -> list[str]:
        """The notes, each on one line, with a # before it."""
        return [f"# {printable(note)}" for note in self.notes]


def joint_names(model: Model) -> list[str]:
    """As the model file says, else joint_1 and so on."""
    return [joint.name or f"joint_{i}" for i, joint in enumerate(model.joints, 1)]


# --- CSV ---


def csv_text(motion: SampledMotion) -> str:
    """Times, positions and speeds."""
    units = [joint.position_unit for joint in motion.model.joints]
    heads = ["t [s]", *(f"q{i} [{unit}]" for i, unit in enumerate(units, 1))]
    heads += [f"qd{i} [{unit}/s]" for i, unit in enumerate(units, 1)]
    row = ",".join(["%.6f", *["%.10f"] * (2 * motion.model.n)])
    table = np.vstack([motion.t, motion.q, motion.qd]).T.tolist()
    return "\n".join([*motion.comments, ",".join(heads), *(row % tuple(values) for values in table)]) + "\n"


# --- ROS 2 ---


def trajectory_yaml(motion: SampledMotion) -> str:
    """A trajectory_msgs/msg/JointTrajectory, as `ros2 topic pub` and the goal of follow_joint_trajectory take it."""
    lines = [
        *motion.comments,
        "header: {stamp: {sec: 0, nanosec: 0}, frame_id: ''}",
        # JSON strings are YAML.
        f"joint_names: {json.dumps(list(motion.names))}",
        "points:",
    ]
    for t, q, qd, qdd in zip(motion.t, motion.q.T, motion.qd.T, motion.qdd.T, strict=True):
        sec, nanosec = _stamp(t)
        rows = ", ".join(
            f"{name}: [{', '.join(f'{x:.9g}' for x in values)}]"
            for name, values in (("positions", q), ("velocities", qd), ("accelerations", qdd))
        )
        lines.append(f"- {{{rows}, effort: [], time_from_start: {{sec: {sec}, nanosec: {nanosec}}}}}")
    return "\n".join(lines) + "\n"


def _stamp(t: float) -> tuple[int, int]:
    nanoseconds = round(t * 1e9)
    return nanoseconds // 10**9, nanoseconds % 10**9


_RULE = "=" * 80
_DEFINITION = f"""\
std_msgs/Header header
string[] joint_names
trajectory_msgs/JointTrajectoryPoint[] points
{_RULE}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{_RULE}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
{_RULE}
MSG: trajectory_msgs/JointTrajectoryPoint
float64[] positions
float64[] velocities
float64[] accelerations
float64[] effort
builtin_interfaces/Duration time_from_start
{_RULE}
MSG: builtin_interfaces/Duration
int32 sec
uint32 nanosec
"""
"""Of trajectory_msgs/msg/JointTrajectory, as ROS 2 and MCAP write it."""
TOPIC = "/joint_trajectory_controller/joint_trajectory"
_MAGIC = b"\x89MCAP0\r\n"


def trajectory_mcap(motion: SampledMotion) -> bytes:
    """A log with one message of trajectory_msgs/msg/JointTrajectory. Source: the specification of MCAP, version 0."""
    notes = _mcap_text("notes") + _mcap_text("\n".join(motion.notes))
    records = [
        (0x01, _mcap_text("ros2") + _mcap_text("tendon")),
        (0x03, pack("<H", 1) + _mcap_text("trajectory_msgs/msg/JointTrajectory") + _mcap_text("ros2msg")
            + _mcap_text(_DEFINITION)),
        (0x04, pack("<HH", 1, 1) + _mcap_text(TOPIC) + _mcap_text("cdr") + pack("<I", len(notes)) + notes),
        (0x05, pack("<HIQQ", 1, 0, 0, 0) + _cdr(motion)),
        (0x0F, pack("<I", 0)),
        (0x02, pack("<QQI", 0, 0, 0)),
    ]  # fmt: skip
    return _MAGIC + b"".join(pack("<BQ", code, len(data)) + data for code, data in records) + _MAGIC


def _mcap_text(text: str) -> bytes:
    data = text.encode()
    return pack("<I", len(data)) + data


def _cdr(motion: SampledMotion) -> bytes:
    """The message in little-endian CDR: every number is aligned to its size."""
    made = bytearray()

    def put(layout: str, size: int, *values: float) -> None:
        made.extend(bytes(-len(made) % size))
        made.extend(pack("<" + layout, *values))

    def text(value: str) -> None:
        data = value.encode() + b"\0"
        put("I", 4, len(data))
        made.extend(data)

    put("iI", 4, 0, 0)
    text("")
    put("I", 4, len(motion.names))
    for name in motion.names:
        text(name)
    put("I", 4, len(motion.t))
    for t, *rows in zip(motion.t, motion.q.T, motion.qd.T, motion.qdd.T, strict=True):
        for values in rows:
            put("I", 4, len(values))
            put(f"{len(values)}d", 8, *values)
        put("I", 4, 0)
        put("iI", 4, *_stamp(t))
    return b"\x00\x01\x00\x00" + bytes(made)


# --- URScript ---


def urscript(motion: SampledMotion, options: MotionOptions) -> str:
    """A program of servoj that starts only where the motion does, and stops at its end. Raises ExperimentError."""
    if motion.model.n != 6 or any(joint.type != "revolute" for joint in motion.model.joints):
        raise ExperimentError(f"{motion.model.name}: URScript is for arms of six revolute joints")
    step = f"t={1.0 / options.rate_of('urscript'):.6g}, lookahead_time={options.lookahead:g}, gain={options.gain:g}"
    lines = [
        *motion.comments,
        f"# joints, from the base on: {printable(', '.join(motion.names))}",
        "def tendon_motion():",
        f"  start = {_pose(motion.q[:, 0])}",
        "  now = get_actual_joint_positions()",
        "  joint = 0",
        "  while joint < 6:",
        f"    if norm(now[joint] - start[joint]) > {AT_START:g}:",
        '      popup("The arm does not stand where the motion starts", title="Tendon", error=True, blocking=True)',
        "      halt",
        "    end",
        "    joint = joint + 1",
        "  end",
        *(f"  servoj({_pose(q)}, 0, 0, {step})" for q in motion.q.T),
        f"  stopj({STOPPING:g})",
        "end",
        "tendon_motion()",
    ]
    return "\n".join(lines) + "\n"


def _pose(q: Array) -> str:
    return f"[{', '.join(f'{x:.8f}' for x in q)}]"


# --- LeRobot ---


def lerobot_parquet(motion: SampledMotion, options: MotionOptions) -> bytes:
    """An episode's actions with the columns of a LeRobotDataset. Names, unit and rate are in the file's metadata under
    "info", as meta/info.json has them. Raises ExperimentError."""
    try:
        import pyarrow as pa
        from pyarrow import parquet
    except ImportError as error:
        why = f"LeRobot's Parquet needs pyarrow, the extra `parquet`; run: {sys.executable} -m pip install pyarrow"
        raise ExperimentError(why) from error
    frames, fps = len(motion.t), options.rate_of("lerobot")
    action = _in_unit(motion, options).astype(np.float32)
    columns = {
        "action": pa.FixedSizeListArray.from_arrays(pa.array(action.T.ravel()), motion.model.n),
        "timestamp": pa.array(motion.t.astype(np.float32)),
        "frame_index": pa.array(np.arange(frames)),
        "episode_index": pa.array(np.zeros(frames, dtype=np.int64)),
        "index": pa.array(np.arange(frames)),
        "task_index": pa.array(np.zeros(frames, dtype=np.int64)),
    }
    names = [f"{name}.pos" for name in motion.names]
    feature = {"dtype": "float32", "shape": [motion.model.n], "names": names, "units": options.unit}
    info = {"fps": fps, "features": {"action": feature}, "notes": list(motion.notes)}
    made = BytesIO()
    parquet.write_table(pa.table(columns).replace_schema_metadata({"info": json.dumps(info)}), made)
    return made.getvalue()


def _in_unit(motion: SampledMotion, options: MotionOptions) -> Array:
    """(n, N) positions as LeRobot's robots take them."""
    if options.unit not in UNITS:
        raise ExperimentError(f"--unit {options.unit}: expected {', '.join(UNITS)}")
    if options.unit == "rad":
        return motion.q
    if options.unit == "deg":
        turns = np.array([[joint.type == "revolute"] for joint in motion.model.joints])
        return np.where(turns, np.degrees(motion.q), motion.q)
    ranges = [joint.position_limits for joint in motion.model.joints]
    if missing := [str(i) for i, limits in enumerate(ranges, 1) if limits is None]:
        raise ExperimentError(
            f"--unit normalised: the model file has no range of joint {', '.join(missing)}; add position = [low, high] "
            "to [joint.limits], as the robot was calibrated"
        )
    low, high = np.array(ranges, dtype=np.float64).T[:, :, None]
    return NORMALISED * (2 * (motion.q - low) / (high - low) - 1)


# --- by name ---


def unit_of(to: str, options: MotionOptions) -> str:
    """Of the positions in a format; of prismatic joints m in place of rad and deg."""
    if to != "lerobot":
        return "rad"
    return options.unit


@dataclass(frozen=True)
class MotionFormat:
    """endings of --out, and what is written; several where the ending decides."""

    writers: Mapping[str, Callable[[SampledMotion, MotionOptions], bytes]]

    def made(self, motion: SampledMotion, options: MotionOptions, out: Path) -> bytes:
        """The file's content. Raises ExperimentError for an ending of `out` that the format does not have."""
        name = str(out).lower()
        found = next((writer for ending, writer in self.writers.items() if name.endswith(ending)), None)
        if found is None:
            raise ExperimentError(f"--out {out}: expected a name that ends in {' or '.join(self.writers)}")
        return found(motion, options)


FORMATS: Mapping[str, MotionFormat] = {
    "csv": MotionFormat(
        {
            ".csv": lambda motion, _: csv_text(motion).encode(),
            ".csv.gz": lambda motion, _: gzip.compress(csv_text(motion).encode(), mtime=0),
        }
    ),
    "joint_trajectory": MotionFormat(
        {
            ".yaml": lambda motion, _: trajectory_yaml(motion).encode(),
            ".yml": lambda motion, _: trajectory_yaml(motion).encode(),
            ".mcap": lambda motion, _: trajectory_mcap(motion),
        }
    ),
    "urscript": MotionFormat({".script": lambda motion, options: urscript(motion, options).encode()}),
    "lerobot": MotionFormat({".parquet": lerobot_parquet}),
}
"""By the word of --to."""

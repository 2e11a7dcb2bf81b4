"""A recording of an arm in SI units: read from any format, which the file's content decides, checked, and written."""

from __future__ import annotations

import gzip
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from html import escape
from pathlib import Path
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from runtime import files
from runtime.recordings import array_files, bam_logs, clocks, lerobot, names, ros_logs, samples, text
from runtime.recordings.clocks import BroughtClock
from runtime.recordings.columns import (
    IN_PLANE,
    IN_SPACE,
    OFFERED,
    UNITS,
    RecordedArm,
    columns,
    normal_unit,
    numbered_signal,
)
from runtime.recordings.contents import (
    Array,
    Contents,
    Refusal,
    Samples,
    check_command,
    check_length,
    check_moving,
    gap_free_segments,
    median_step,
    printable,
    run_numbers,
)
from runtime.recordings.contents import RecordingError as RecordingError
from runtime.recordings.driven import DrivenJoint, ToldGain, driven_joints, driven_notes
from runtime.recordings.text import check_file
from symbolic.model_file.arm import LINK_TORQUE, MOTOR_TORQUE, TORQUES, WEIGHTLESS, Torque
from symbolic.model_file.checks import nearest, quote
from symbolic.model_file.drive_laws import COMMANDS

EXPECTED = "CSV, plain or gzip, or MCAP, a ROS 2 bag, MATLAB, HDF5, Parquet or NumPy"
_HEAD = 1024

Reader = Callable[[Path, Refusal], Contents]

_BY_START: Mapping[bytes, Reader] = {
    ros_logs.MCAP: ros_logs.open_mcap,
    ros_logs.SQLITE: ros_logs.open_sqlite_bag,
    array_files.MATLAB_5: array_files.open_matlab,
    array_files.MATLAB_7_3: array_files.open_hdf5,
    array_files.HDF5_SIGNATURE: array_files.open_hdf5,
    array_files.PARQUET: lerobot.open_any_parquet,
    array_files.NPY: array_files.open_numpy,
    array_files.ZIP: array_files.open_numpy,
    bam_logs.JSON: bam_logs.open_bam,
}
"""First bytes of a file -> the reader of its format."""

_REFUSED: Mapping[bytes, str] = {
    b"#ROSBAG V": "is a ROS 1 bag; convert it with: pip install rosbags; rosbags-convert --src FILE --dst FOLDER",
    b"\x28\xb5\x2f\xfd": "is compressed with zstd; decompress it with: zstd -d FILE",
    b"BZh": "is compressed with bzip2; decompress it with: bunzip2 FILE",
    b"\xfd7zXZ": "is compressed with xz; decompress it with: unxz FILE",
    b"\xd0\xcf\x11\xe0": "is an old Excel workbook; save the sheet as CSV",
}


def opened(path: Path, refuse: Refusal) -> Contents:
    """The contents of a recording; its first bytes decide the format. Raises RecordingError."""
    if os.path.isdir(path):
        return _folder(path, refuse)
    check_file(path, f"a recording in {EXPECTED}", refuse)
    try:
        with open(path, "rb") as file:
            head = file.read(_HEAD)
    except (OSError, ValueError) as error:
        refuse(f"cannot be read: {getattr(error, 'strerror', None) or error}")
    for start, why in _REFUSED.items():
        if head.startswith(start):
            refuse(why)
    if head[array_files.HDF5_USER_BLOCK :].startswith(array_files.HDF5_SIGNATURE):
        return array_files.open_hdf5(path, refuse)
    reader = next((found for start, found in _BY_START.items() if head.startswith(start)), text.open_text)
    return reader(path, refuse)


def _folder(path: Path, refuse: Refusal) -> Contents:
    """A ROS 2 bag or a LeRobot data set, which are folders."""
    if lerobot.is_data_set(path):
        return lerobot.open_data_set(path, refuse)
    bags = sorted([*path.glob("*.mcap"), *path.glob("*.db3")])
    if not bags:
        refuse(f"is a directory without a ROS 2 bag; expected a recording in {EXPECTED}")
    if len(bags) > 1:
        listed = ", ".join(bag.name for bag in bags[:4])
        refuse(f"is a bag in {len(bags)} files; pass each as a recording of its own: {listed}")
    return opened(bags[0], refuse)


@dataclass(frozen=True, repr=False)
class Recording:
    """Samples of n joints in SI; positions in rad or m, torques in N m or N, by the joint's type.

    t             (N,) s, each run as recorded
    run           (N,) whole numbers; time may restart where it changes
    q, tau        (n, N) motor encoder / gear ratio, motor torque * gear ratio
    qd, q_desired, q_link, tau_link, tau_rigid
                  (n, N), or None if the file has none; a joint without the signal has a row of NaN
    tau_rigid     the user's own prediction of tau without friction, with rotors and contact
    commands      further signals that a drive's law reads, "duty" and the like, as qd: name -> (n, N)
    driven        of each joint whose torque a law makes: the law and its columns; None: tau is recorded
    temperature   (N,) °C or None for each joint
    force         force on the arm at the tip in base axes, or None: (2, N) N along x and y; of a spatial arm (6, N),
                  N along x, y, z and N m about them
    segments      gap-free pieces of at least settings.MIN_SEGMENT samples, each within one run
    types         "revolute" or "prismatic" for each joint
    cells         signal -> its field, as `--map` takes it
    units         signal -> the unit in which it was read, where the file or `--map` states one
    torque        what its torques are; None: nobody says, and they are taken for the motors'
    torque_by     who says so
    currents      torque signals that are in A, because nothing is known of the motors
    clocks        signals that were sampled by another clock than the positions, and the offset of that clock
    notes         what users should know about how the file was read, a line each
    """

    path: Path
    t: Array
    run: NDArray[np.int64]
    q: Array
    tau: Array
    types: tuple[str, ...]
    segments: tuple[slice, ...]
    temperature: tuple[Array | None, ...]
    qd: Array | None = None
    q_desired: Array | None = None
    q_link: Array | None = None
    tau_link: Array | None = None
    tau_rigid: Array | None = None
    force: Array | None = None
    commands: Mapping[str, Array] = field(default_factory=dict)
    driven: tuple[DrivenJoint | None, ...] = ()
    cells: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    torque: Torque | None = None
    torque_by: str = ""
    currents: frozenset[str] = frozenset()
    clocks: tuple[BroughtClock, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def dt(self) -> float:
        """Median step, s."""
        return median_step(self.t, self.run)

    @property
    def gains_open(self) -> bool:
        """Whether the model file leaves gains open of a drive whose law makes a torque."""
        return any(joint is not None and joint.unknown for joint in self.driven)

    def with_torques(self, tau: Array) -> Recording:
        """The same motion with other torques (n, N)."""
        return replace(self, tau=np.ascontiguousarray(tau))

    def sparing(self, part: float) -> Recording:
        """With a part of the samples that limits of drives may cut (`DrivenJoint.spared`)."""
        return replace(self, driven=tuple(joint and replace(joint, spared=part) for joint in self.driven))

    def with_gains(self, told: Mapping[int, Mapping[str, ToldGain]]) -> Recording:
        """With identified coefficients of drives, by joint (0-based), and the torques that they make."""
        if not any(self.driven):
            return self
        driven = [joint and joint.with_told(told.get(i, {})) for i, joint in enumerate(self.driven)]
        tau = [row if joint is None else joint.torque for row, joint in zip(self.tau, driven, strict=True)]
        return replace(self.with_torques(np.array(tau)), driven=tuple(driven))

    def save(self, path: Path | str) -> None:
        """Same as `write`."""
        write(path, self)

    def __repr__(self) -> str:
        n, samples = self.q.shape
        extra = [name for name in ("qd", "q_link", "tau_link", "tau_rigid", "force") if getattr(self, name) is not None]
        extra += ["temperature"] * any(c is not None for c in self.temperature)
        what = f"{n} joint{'s' if n > 1 else ''}, {samples} samples, {samples * self.dt:.4g} s at {1 / self.dt:.4g} Hz"
        return f"{self.path}: {what}" + (f", with {', '.join(extra)}" if extra else "")

    def _repr_html_(self) -> str:
        """As a notebook's cell shows it: the same line, and each joint's range and torque."""
        rows: list[tuple[str, ...]] = [
            ("joint", "smallest position", "largest position", "torque, rms", "largest torque")
        ]
        for i, (q, tau, kind) in enumerate(zip(self.q, self.tau, self.types, strict=True), 1):
            position, force = ("rad", "N m") if kind == "revolute" else ("m", "N")
            ends = [f"{x:.4g} {position}" for x in (q.min(), q.max())]
            sizes = [f"{x:.4g} {force}" for x in (np.sqrt(np.mean(tau**2)), np.abs(tau).max())]
            rows.append((str(i), *ends, *sizes))
        cells = ("".join(f"<td>{cell}</td>" for cell in row) for row in rows)
        notes = "".join(f"<p>{escape(note)}</p>" for note in self.notes)
        return f"<p><b>{escape(repr(self))}</b></p><table><tr>{'</tr><tr>'.join(cells)}</tr></table>{notes}"


def drives_of(recordings: Sequence[Recording]) -> tuple[DrivenJoint | None, ...]:
    """Of each joint the drive that makes its torque in the first recording without one; None: all have one."""
    rows = [r.driven or (None,) * len(r.q) for r in recordings]
    return tuple(next((drive for drive in joint if drive is not None), None) for joint in zip(*rows, strict=True))


def read(
    path: Path | str, arm: RecordedArm | None, mapping: Mapping[str, str] | None = None, allow_gaps: bool = False
) -> Recording:
    """The recording at `path`, in any format of EXPECTED; arguments as in `checked`. Raises RecordingError."""
    refuse = Refusal(printable(path))
    return checked(opened(Path(path), refuse), Path(path), arm, mapping, allow_gaps, refuse)


def checked(
    contents: Contents,
    path: Path,
    arm: RecordedArm | None,
    mapping: Mapping[str, str] | None,
    allow_gaps: bool,
    refuse: Refusal,
) -> Recording:
    """Contents as a recording in SI, named by its path.

    arm         None: as many revolute joints as the contents name
    mapping     signal name -> field, where the contents have other names; TORQUE -> what the torques are
    allow_gaps  split at gaps and drop samples with a NaN instead of refusing them
    Raises RecordingError.
    """

    def fail(message: str) -> NoReturn:
        refuse(message, contents.header)

    mapping = dict(mapping or {})
    stated = mapping.pop(TORQUE, "")
    if arm is None:
        arm = RecordedArm.without_model(names.count_joints(contents, mapping, fail))
    understood = names.understood(contents, arm.joints, mapping, fail)
    header = [f.name for f in contents.fields]
    used = columns(header, understood.known, arm=arm, mapping=understood.mapping, fail=fail)
    look = samples.Look(arm.joints, allow_gaps, refuse)
    table, apart = clocks.on_one(contents, used, allow_gaps, refuse, look)
    cells = {name: column.cell for name, column in used.items()}
    arm, named = arm.with_laws(used), arm
    made = _recording(path, table, cells, arm=arm, allow_gaps=allow_gaps, refuse=refuse)
    # A wrap after 2 pi says that the unit is rad.
    units = dict.fromkeys(table.turned, "rad") | {name: column.unit for name, column in used.items() if column.unit}
    in_ampere = {name for name, unit in units.items() if UNITS[normal_unit(unit)][0] == "current"}
    currents = frozenset(in_ampere if arm.keeps_currents else ())
    notes = (
        *contents.notes,
        *understood.notes,
        *table.notes,
        *map(str, apart),
        *(driven_notes(made.driven) if arm is named else _NO_TORQUE),
    )
    made = replace(made, units=units, currents=currents, clocks=apart, notes=notes)
    log = understood.log
    said = (stated, "--map"), (contents.torque, "the file"), (log and log.torque, log and log.name)
    torque, by = next(((what, who) for what, who in (*said, (arm.torque, "the model file")) if what), (None, ""))
    if all(made.driven) and torque in (LINK_TORQUE, WEIGHTLESS):
        # What a drive makes has rotors, friction and gravity, whatever other recordings of the arm hold.
        torque, by = MOTOR_TORQUE, "the law of the drive"
    return replace(made, torque=_torque(torque, by or "", refuse), torque_by=by or "")


_NO_TORQUE = ("no torque is recorded, and no law of a drive is stated",)

TORQUE = "torque"
"""The entry of `--map` that says what a recording's torques are."""


def _torque(stated: str | None, by: str, refuse: Refusal) -> Torque | None:
    """What torques are, checked."""
    known = next((torque for torque in TORQUES if torque == stated), None)
    if stated and known is None:
        close = nearest(stated, TORQUES)
        hint = f'; did you mean "{close}"?' if close else ""
        refuse(f"torque is {quote(stated)} ({by}); expected {' or '.join(TORQUES)}{hint}")
    return known


def _recording(
    path: Path, table: Samples, cells: Mapping[str, str], arm: RecordedArm, allow_gaps: bool, refuse: Refusal
) -> Recording:
    signals, t, n = table.signals, table.signals["t"], len(arm.joints)
    check_length(t, allow_gaps, refuse)
    run = run_numbers(table, refuse)
    segments = gap_free_segments(table, run, cells["t"].split(" [")[0], allow_gaps=allow_gaps, refuse=refuse)

    def rows(pattern: str) -> Array | None:
        names = [pattern.format(i) for i in range(1, n + 1)]
        if not any(name in signals for name in names):
            return None
        return np.ascontiguousarray([signals.get(name, np.full(len(t), np.nan)) for name in names])

    q = rows("q{}")
    assert q is not None
    driven = driven_joints(arm.joints, signals, t, run)
    for i, joint in enumerate(driven, 1):
        if joint is not None:
            check_command(i, q[i - 1], signals.get(f"q{i}_desired"), refuse)
            signals[f"tau{i}"] = joint.torque
            if joint.rate_recorded:
                signals[f"qd{i}"] = joint.signals["qd"]
    tau = rows("tau{}")
    assert tau is not None
    check_moving(q, tau, refuse)
    sent = {name: rows(numbered_signal(name)) for name in COMMANDS if name != "q_desired"}
    rigid = rows("tau{}_rigid")
    for i in range(n):
        if rigid is not None and f"tau{i + 1}_rigid" not in signals:
            refuse(f"has no column tau{i + 1}_rigid; record the rigid-body torque of every joint, or of none")
    acting, force = IN_SPACE if arm.space else IN_PLANE, None
    if any(name in signals for name in acting):
        force = np.array([signals.get(name, np.full(len(t), np.nan)) for name in acting])
    return Recording(
        path=path,
        t=t,
        run=run,
        q=q,
        tau=tau,
        qd=rows("qd{}"),
        q_desired=rows("q{}_desired"),
        q_link=rows("q{}_link"),
        tau_link=rows("tau{}_link"),
        tau_rigid=rigid,
        temperature=tuple(signals.get(f"temperature{i}") for i in range(1, n + 1)),
        force=force,
        commands={name: found for name, found in sent.items() if found is not None},
        driven=driven,
        segments=segments,
        types=tuple(joint.type for joint in arm.joints),
        cells=cells,
    )


def _recorded_torque(recording: Recording) -> Array:
    """tau (n, N) where it is recorded; NaN at a joint where a law makes it."""
    made = [joint is not None for joint in recording.driven] or [False]
    return np.where(np.array(made)[:, None], np.nan, recording.tau) if any(made) else recording.tau


def _units(command: str, position: Sequence[str]) -> list[str]:
    kind = COMMANDS[command].kind
    if kind == "rate":
        return [f"{unit}/s" for unit in position]
    return ["" if kind == "ratio" else OFFERED[kind][0]] * len(position)


def header_cell(name: str, unit: str) -> str:
    """A column's name with its unit, if it has one."""
    return f"{name} [{unit}]" if unit else name


def measured(recording: Recording) -> Iterator[tuple[str, str, Array]]:
    """Name, SI unit and values (N,) of every recorded signal, in the order in which `write` writes them."""
    position = ["m" if kind == "prismatic" else "rad" for kind in recording.types]
    force = ["N" if kind == "prismatic" else "N m" for kind in recording.types]
    groups = (
        ("q{}", recording.q, position),
        ("qd{}", recording.qd, [f"{unit}/s" for unit in position]),
        ("tau{}", _recorded_torque(recording), force),
        ("q{}_desired", recording.q_desired, position),
        *((numbered_signal(name), rows, _units(name, position)) for name, rows in recording.commands.items()),
        ("q{}_link", recording.q_link, position),
        ("tau{}_link", recording.tau_link, force),
        ("tau{}_rigid", recording.tau_rigid, force),
    )
    listed = [
        (signal, "A" if signal in recording.currents else unit, values[i - 1])
        for name, values, units in groups
        if values is not None
        for i, unit in enumerate(units, 1)
        for signal in (name.format(i),)
    ]
    listed += [
        (f"temperature{i}", "degC", found) for i, found in enumerate(recording.temperature, 1) if found is not None
    ]
    acting = zip(IN_SPACE.items(), () if recording.force is None else recording.force, strict=False)
    listed += [(name, {"force": "N", "torque": "N m"}[kind], values) for (name, kind), values in acting]
    return ((name, unit, values) for name, unit, values in listed if not np.isnan(values).all())


def write(path: Path | str, recording: Recording) -> None:
    """Writes a recording as CSV with 12 digits, compressed if the name ends in .gz.

    Equal recordings give equal bytes. Raises OSError.
    """
    cells: list[tuple[str, Array]] = []
    head = [] if recording.torque is None else [f'# {TORQUE} = "{recording.torque}"']
    if len(np.unique(recording.run)) > 1:
        cells.append(("run", recording.run.astype(float)))
    cells.append(("t [s]", recording.t))
    cells += [(header_cell(name, unit), values) for name, unit, values in measured(recording)]
    row = ",".join(["%.12g"] * len(cells))
    lines = [*head, ",".join(name for name, _ in cells)]
    lines += [row % values for values in zip(*(column.tolist() for _, column in cells), strict=True)]
    data = ("\n".join(lines) + "\n").encode()
    files.replace(path, gzip.compress(data, mtime=0) if str(path).endswith(".gz") else data)

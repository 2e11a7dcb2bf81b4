"""Which field of a file is which signal of the arm, and in which unit: columns by name, `--map`, conversion to SI."""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import pi
from typing import Final, NoReturn

from runtime.recordings.contents import some
from runtime.wording import joints_said
from symbolic.model_file.arm import DescribedJoint, Drive, Torque
from symbolic.model_file.checks import quote
from symbolic.model_file.drive_laws import COMMANDS, LAWS, DriveLaw, parted

_DEGREE = pi / 180
_ANGLES = {"rad": 1.0, "radians": 1.0, "mrad": 1e-3, "urad": 1e-6, "rev": 2 * pi, "turn": 2 * pi}
_ANGLES |= dict.fromkeys(("deg", "degrees", "Grad", "°"), _DEGREE)
_ANGLES |= {"mdeg": _DEGREE / 1e3, "arcmin": _DEGREE / 60, "arcsec": _DEGREE / 3600}
_TICKS = {"tick4096": 2 * pi / 4096, "tick1024": 300 * _DEGREE / 1024}
"""Steps of a servo's register of positions: a turn, or 300 degrees of the smaller models."""
_ANGLES |= _TICKS
_TORQUES = {"N m": 1.0, "mN m": 1e-3, "N cm": 1e-2, "N mm": 1e-3, "kN m": 1e3}
_PER_SECOND = ("rad", "mrad", "deg", "Grad", "°", "rev", "turn", *_TICKS)
_PER_MINUTE = dict.fromkeys(("rpm", "U/min", "rev/min", "1/min"), pi / 30)
_FACTORS = {
    "time": {"s": 1.0, "sec": 1.0, "seconds": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0},
    "angle": _ANGLES,
    "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6},
    "angular rate": {f"{u}/s": _ANGLES[u] for u in _PER_SECOND} | _PER_MINUTE | {"rps": 2 * pi},
    "speed": {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3, "um/s": 1e-6, "m/min": 1 / 60, "mm/min": 1e-3 / 60},
    "torque": _TORQUES | {unit.replace(" ", ""): size for unit, size in _TORQUES.items()} | {"uNm": 1e-6},
    "force": {"N": 1.0, "mN": 1e-3, "kN": 1e3},
    "current": {"A": 1.0, "mA": 1e-3, "uA": 1e-6},
    "temperature": {"degC": 1.0, "°C": 1.0, "C": 1.0, "K": 1.0, "degF": 5 / 9, "°F": 5 / 9},
    "voltage": {"V": 1.0, "mV": 1e-3, "kV": 1e3},
    "ratio": {"1": 1.0, "%": 1e-2},
}
_ZERO = {"K": -273.15, "degF": -160 / 9, "°F": -160 / 9} | {u: -int(u[4:]) / 2 * size for u, size in _TICKS.items()}
"""Offset in SI; servos have their zero in the middle of the register, 2048 of 4096."""


class _Units(Mapping[str, tuple[str, float, float]]):
    """Units by name, and their multiples, such as 2.69 mA for the step of a register."""

    _named: Final = {u: (kind, f, _ZERO.get(u, 0.0)) for kind, factors in _FACTORS.items() for u, f in factors.items()}
    _multiple: Final = re.compile(r"(\d{1,6}(?:\.\d{1,9})?) ?(\D.*)", re.ASCII)

    def __getitem__(self, unit: str) -> tuple[str, float, float]:
        if unit not in self._named and (match := self._multiple.fullmatch(unit)):
            kind, factor, zero = self._named[match[2]]
            if float(match[1]) and not zero:
                return kind, float(match[1]) * factor, 0.0
        return self._named[unit]

    def __iter__(self) -> Iterator[str]:
        return iter(self._named)

    def __len__(self) -> int:
        return len(self._named)


UNITS: Final = _Units()
"""unit -> (dimension, factor to SI, offset in SI); temperatures are in °C."""

OFFERED = {
    "time": ("s", "ms", "us", "ns"),
    "angle": ("rad", "deg", "mrad", "rev"),
    "length": ("m", "mm"),
    "angular rate": ("rad/s", "deg/s", "rpm", "rev/s"),
    "speed": ("m/s", "mm/s"),
    "torque": ("N m", "mN m"),
    "force": ("N", "mN"),
    "current": ("A", "mA"),
    "temperature": ("degC", "K"),
    "voltage": ("V", "mV"),
    "ratio": ("1", "%"),
}
"""Usual units of each dimension, the one of SI first."""


def normal_unit(unit: str) -> str:
    """A unit as it is spelled in UNITS."""
    unit = unit.replace("µ", "u").replace("μ", "u")
    return " ".join(re.sub(r"[·⋅*]|(?<!\d)\.|\.(?!\d)", " ", unit).split())


UNTOLD = "deg or normalised"
"""Unit of positions that are in degrees, or in percent of a range that their file does not state."""


def unit_hint(unit: str) -> str:
    """What to do about an unknown unit."""
    if unit == UNTOLD:
        return (
            'the file does not say which of the two; if degrees, pass --map q="observation.state [deg]" '
            '--map q_desired="action [deg]"; normalised positions need the range of each joint: record in degrees'
        )
    if unit.lower() in ("counts", "count", "cts", "inc", "increments", "ticks", "lsb", "qc"):
        return "state how much one is, such as [tick4096] of a servo or [0.01 deg]"
    by_lower = {known.lower(): known for known in UNITS}
    close = difflib.get_close_matches(normal_unit(unit).lower()[:40], by_lower, n=1, cutoff=0.5)
    return f'did you mean "{by_lower[close[0]]}"?' if close else "write it in SI, without a unit"


NUMBERED = "#{}"
"""Names of the columns, counted from 1, of a file without a header."""
_LAYOUTS = (("q", "tau"), ("q", "qd", "tau"))
"""Signals of every joint in a file without a header."""


def in_order(names: str) -> Iterator[str]:
    """Names of the columns as entries of `--map`: `t,q1 [deg],-,tau1` is t=#1, q1=#2 [deg], tau1=#4; `-` skips one."""
    for number, cell in enumerate(names.split(","), 1):
        name, bracket, unit = cell.partition("[")
        if name.strip() not in ("", "-"):
            yield f"{name.strip()}={NUMBERED.format(number)}{' ' * bool(bracket)}{bracket}{unit}"


def unnamed(count: int, n: int | None = None) -> str:
    """The message for a file without a header whose lines have `count` numbers, with the option to type.

    n   joints of the arm; None: the number that fits with rates, without rates, or both
    """
    without, with_rates = _LAYOUTS
    if n is None:
        fitting = [(s, (count - 1) // len(s)) for s in _LAYOUTS if count > 1 and (count - 1) % len(s) == 0]
    else:
        fitting = [(with_rates, n)] * (count == 1 + 3 * n) + [(without, n)]
    layouts = [["t", *(f"{x}{i}" for x in s for i in range(1, k + 1))] for s, k in fitting or [(without, 1)]]
    begins = f"its first line is no header but {count} number{'s' if count > 1 else ''}"
    if len(layouts[0]) > count:
        return f"{begins}; expected at least {len(layouts[0])}: {','.join(layouts[0])}"
    typed = (f"--columns {','.join([*plain, *'-' * (count - len(plain))])}" for plain in layouts)
    return f"{begins}; name its {count} columns with {' or '.join(typed)}"


Fail = Callable[[str], NoReturn]

_ROTARY = {"position": "angle", "rate": "angular rate", "force": "torque"}
_LINEAR = {"position": "length", "rate": "speed", "force": "force"}
JOINT_SIGNALS = "q|qd|dq|tau|temperature|duty|voltage|bus_voltage|current"
"""Stems of a joint's signals, as a pattern."""
_JOINT_COLUMN = re.compile(rf"({JOINT_SIGNALS})(\d{{1,3}})((?:_desired|_link|_rigid)?)", re.ASCII)
_KINDS = {
    ("q", ""): "position",
    ("q", "_link"): "position",
    ("qd", ""): "rate",
    ("tau", ""): "force",
    ("tau", "_link"): "force",
    ("tau", "_rigid"): "force",
    ("temperature", ""): "temperature",
    **{parted(command.name): command.kind for command in COMMANDS.values()},
}
_SIGNED = ("position", "rate", "force", "ratio", "voltage", "current")
"""Kinds of signals whose sign `--map` may turn."""
_PLAIN = {"t": "time", "run": "run"}
IN_PLANE = {"fx": "force", "fy": "force"}
IN_SPACE = {**IN_PLANE, "fz": "force", "mx": "torque", "my": "torque", "mz": "torque"}
"""Components of the force and moment at the tip of a planar and of a spatial arm, in the order of a recording."""


@dataclass(frozen=True)
class RecordedArm:
    """The arm of a recording, as far as a reader needs it.

    joints           their types, torque constants and names are read
    space            whether it is spatial: six components of force and moment at the tip instead of two
    torque           what its torques are, unless the recording says something else; None: not stated
    keeps_currents   torques in A stay in A, because nothing is known of the motors
    any_law          a joint without a torque gets the first law of a drive for which there are columns
    """

    joints: Sequence[DescribedJoint]
    space: bool
    torque: Torque | None = None
    keeps_currents: bool = False
    any_law: bool = False

    @classmethod
    def without_model(cls, n: int) -> RecordedArm:
        """n revolute joints of which nothing else is known."""
        joint = DescribedJoint("revolute", None, 1.0, torque_constant=1.0)
        return cls((joint,) * n, space=True, keeps_currents=True, any_law=True)

    def with_laws(self, signals: Collection[str]) -> RecordedArm:
        """The same; if any law will do, joints without a torque have the first one that these signals allow."""
        if not self.any_law:
            return self
        found = []
        for number, joint in enumerate(self.joints, 1):
            drive, laws = joint.drive or Drive(), [law for law in laws_of(signals, number) if law.complete]
            new = f"tau{number}" not in signals and drive.law is None and bool(laws)
            found.append(replace(joint, drive=replace(drive, law=laws[0].law.name)) if new else joint)
        return self if found == list(self.joints) else replace(self, joints=tuple(found))


@dataclass(frozen=True)
class MappedColumn:
    """A column as `--map` takes it: its name, the unit in which it is read ("": that of the file), and whether its sign
    is turned."""

    name: str
    unit: str = ""
    turned: bool = False

    @classmethod
    def of(cls, text: str) -> MappedColumn:
        name, unit = _split(text.strip().removeprefix("-"))
        return cls(name, unit or "", text.strip().startswith("-"))

    def __str__(self) -> str:
        return "-" * self.turned + self.name + f" [{self.unit}]" * bool(self.unit)


@dataclass(frozen=True)
class Column:
    """A signal (`name`, e.g. "qd1") in field `index` of a file; SI value = factor * cell + offset.

    cell   the field as `--map` takes it, with its unit, and a minus if its sign is turned
    unit   None: neither the file nor `--map` states a unit
    """

    name: str
    index: int
    factor: float
    offset: float
    cell: str = ""
    unit: str | None = None


def columns(
    header: Sequence[str], known: Sequence[str], arm: RecordedArm, mapping: Mapping[str, str], fail: Fail
) -> dict[str, Column]:
    """The columns of a recording by signal name.

    header    names of the file's fields
    known     the same, translated to Tendon's names where they are understood
    mapping   signal name -> field, from `--map`
    fail      raises RecordingError with the file's name and the message
    """
    own, joints, space = [_split(cell) for cell in known], arm.joints, arm.space
    beyond = [name for name in (*mapping, *(cell for cell, _ in own)) if name in IN_SPACE and name not in IN_PLANE]
    if beyond and not space:
        fail(
            f"has a column {beyond[0]}, but the arm is planar: of the force at its tip, only {' and '.join(IN_PLANE)} "
            "are read; drop the column or use the model of a spatial arm"
        )
    split = [_split(cell) for cell in header]
    found: dict[str, Column] = {}
    for raw_name, wanted in mapping.items():
        name = raw_name.strip().replace("dq", "qd", 1) if raw_name.strip().startswith("dq") else raw_name.strip()
        if _kind(name, len(joints)) is None:
            last, acting = f" to q{len(joints)}" * (len(joints) > 1), ", ".join(IN_SPACE if space else IN_PLANE)
            commands = ", ".join(name.format(1) for name in map(numbered_signal, COMMANDS) if name != "q{}_desired")
            fail(
                f"--map {name}: no such signal; known are t, q1{last}, tau1, qd1, q1_desired, q1_link, tau1_link, "
                f"tau1_rigid, temperature1, {commands}, {acting}, run"
            )
        index, unit, sign = _mapped(wanted, header, split, name=name, fail=fail)
        if any(column.index == index for column in found.values()):
            fail(f"--map {name}: column {quote(header[index])} is mapped to two signals; expected one")
        column = _column(name, index, unit, joints=joints, fail=fail)
        column = replace(column, cell=wanted.strip(), unit=unit or None)
        if sign < 0 and _kind(name, len(joints)) not in _SIGNED:
            fail(f"--map {name}: {quote(wanted)} has a minus; only positions, rates, torques and commands have one")
        found[name] = replace(column, factor=sign * column.factor, offset=sign * column.offset)
    taken = {column.index for column in found.values()}
    mapped = set(found)
    for index, (cell, unit) in enumerate(own):
        name = cell.replace("dq", "qd", 1) if _JOINT_COLUMN.fullmatch(cell) and cell.startswith("dq") else cell
        if index in taken or name in mapped or not _is_signal(name, len(joints), fail):
            continue
        if name in found:
            fail(f"two columns are {name}: {quote(header[found[name].index])} and {quote(header[index])}; drop one")
        bare, stated = split[index]
        cell = bare if stated or not unit else f"{bare} [{unit}]"
        found[name] = replace(_column(name, index, unit, joints=joints, fail=fail), cell=cell, unit=unit or None)
    joints = arm.with_laws(found).joints
    needed = ["t"] + [f"{s}{i}" for s in ("q", "tau") for i in range(1, len(joints) + 1)]
    for name in needed:
        if name not in found and not _is_made(name, joints, found, fail):
            taken = {column.index for column in found.values()}
            free = [cell.strip() for i, cell in enumerate(header) if i not in taken]
            fail(_missing(name, header, free, len(joints), found))
    return found


def numbered_signal(signal: str) -> str:
    """A joint's signal with a place for the joint's number: q_desired as q{}_desired."""
    return "{}".join(parted(signal))


def _is_made(name: str, joints: Sequence[DescribedJoint], found: Mapping[str, Column], fail: Fail) -> bool:
    """Whether it is a torque that the law of a drive makes from columns; one of these that is missing is an error."""
    drive = joints[int(name[3:]) - 1].drive if name.startswith("tau") else None
    law = LAWS.get(drive.law or "") if drive is not None else None
    if law is None or drive is None:
        return False
    number = name[3:]
    there = {signal for signal in COMMANDS if numbered_signal(signal).format(number) in found}
    for signal in law.reads:
        if law.source(signal, there, drive.gains) is None:
            column = numbered_signal(signal).format(number)
            key = f", or state {law.instead[signal][1]} under [joint.drive]" if signal in law.instead else ""
            fail(
                f"no column {name}, and no column {column}, from which the law {law.name} of the drive of joint "
                f'{number} makes the torque; name it with --map {column}="Header [unit]"{key}'
            )
    return True


def _split(cell: str) -> tuple[str, str | None]:
    """`name [unit]` as (name, unit); `name (unit)` likewise if the unit is known."""
    cell = cell.strip()
    if (match := re.fullmatch(r"(.*?)\[([^\[\]]*)\]", cell)) and not match[2].strip().isdigit():
        return match[1].strip(), match[2].strip()
    if (match := re.fullmatch(r"(.*)\(([^()]*)\)", cell)) and normal_unit(match[2]) in UNITS:
        return match[1].strip(), match[2].strip()
    return cell, None


def stated_unit(cell: str) -> str | None:
    """The unit of a cell `name [unit]` or `name (unit)`; None if it states none."""
    return _split(cell)[1]


def _kind(name: str, n: int) -> str | None:
    if name in _PLAIN or name in IN_SPACE:
        return (_PLAIN | IN_SPACE)[name]
    match = _JOINT_COLUMN.fullmatch(name)
    if match is None or not 1 <= int(match[2]) <= n or str(int(match[2])) != match[2]:
        return None
    return _KINDS.get((match[1], match[3]))


def units_of(signal: str, arm: RecordedArm) -> tuple[str, ...]:
    """Usual units of a signal of an arm, the one of SI first; () for a column run."""
    kind, match = _kind(signal, len(arm.joints)) or "", _JOINT_COLUMN.fullmatch(signal)
    if match:
        kind = (_ROTARY if arm.joints[int(match[2]) - 1].type == "revolute" else _LINEAR).get(kind, kind)
    return OFFERED.get(kind, ()) + (OFFERED["current"] if re.fullmatch(r"tau\d+", signal) else ())


def needed_of(arm: RecordedArm) -> list[str]:
    """Signals that a recording of an arm must have; no torque where a law makes it."""
    made = [joint.drive is not None and joint.drive.law is not None for joint in arm.joints]
    return ["t", *(s for k, law in enumerate(made, 1) for s in (f"q{k}", f"tau{k}")[: 2 - law])]


def signals_of(arm: RecordedArm) -> list[str]:
    """Every signal that a recording of an arm may have, those first that it must have."""
    numbers, needed = range(1, len(arm.joints) + 1), needed_of(arm)
    joints = [f"{name}{k}{ending}" for name, ending in _KINDS for k in numbers]
    return list(dict.fromkeys([*needed, *joints, *(IN_SPACE if arm.space else IN_PLANE), *_PLAIN]))


def _is_signal(name: str, n: int, fail: Fail) -> bool:
    """Whether a column is a signal of the arm; a signal of a joint that the model does not have is an error."""
    match = _JOINT_COLUMN.fullmatch(name)
    if match and not 1 <= int(match[2]) <= n and (match[1], match[3]) in _KINDS:
        joints = "1 joint" if n == 1 else f"{n} joints, counted from 1"
        fail(f"has a column {name}, but the model has {joints}; drop the column or use the model of this arm")
    return _kind(name, n) is not None


def _mapped(
    wanted: str, header: Sequence[str], split: Sequence[tuple[str, str | None]], name: str, fail: Fail
) -> tuple[int, str | None, int]:
    """Index, unit and sign of the field that an entry of `--map` names; its unit replaces the one in the header."""
    hits, unit, sign = _hits(wanted, header, split), _split(wanted)[1], 1
    if not hits and wanted.strip().startswith("-"):
        wanted, sign = wanted.strip()[1:], -1
        hits, unit = _hits(wanted, header, split), _split(wanted)[1]
    if len(hits) > 1:
        fail(f"--map {name}: {len(hits)} columns are called {quote(wanted)}; expected one")
    if not hits and wanted.startswith("#"):
        fail(f"--map {name}: no column {quote(wanted)}; the file has a header ({some(header)}); use its names")
    if not hits:
        close = difflib.get_close_matches(wanted, [h.strip() for h in header], n=1, cutoff=0.5)
        hint = f"did you mean {quote(close[0])}?" if close else f"the file has {some(header)}"
        fail(f"--map {name}: no column {quote(wanted)}; {hint}")
    return hits[0], unit if unit is not None else split[hits[0]][1], sign


def fields_meant(wanted: str, header: Sequence[str]) -> list[int]:
    """Indices of the fields that an entry of `--map` names, with or without a minus."""
    split = [_split(cell) for cell in header]
    return _hits(wanted, header, split) or _hits(wanted.strip().removeprefix("-"), header, split)


def _hits(wanted: str, header: Sequence[str], split: Sequence[tuple[str, str | None]]) -> list[int]:
    """Indices of the fields that a text names: equal text, else equal names, else the last part of a long name."""
    cell, unit = _split(wanted)
    ends = (f".{cell}", f"/{cell}")
    ways = (
        [i for i, text in enumerate(header) if text.strip() == wanted.strip()],
        [i for i, (c, u) in enumerate(split) if c == cell and (u is None or unit is None or u == unit)],
        [i for i, (c, _) in enumerate(split) if c == cell],
        [i for i, text in enumerate(header) if text.strip() == cell],
        [i for i, (c, _) in enumerate(split) if cell and c.endswith(ends)],
    )
    return next(filter(None, ways), [])


def _column(name: str, index: int, unit: str | None, joints: Sequence[DescribedJoint], fail: Fail) -> Column:
    kind = _kind(name, len(joints))
    if kind == "run":
        if unit:
            fail(f"run has the unit [{unit[:20]}]; expected whole numbers without a unit")
        return Column(name, index, 1.0, 0.0)
    if unit is None or unit == "":
        return Column(name, index, 1.0, 0.0)
    if normal_unit(unit) not in UNITS:
        fail(f"{name} has the unknown unit {quote(unit)}; {unit_hint(unit)}")
    dimension, factor, offset = UNITS[normal_unit(unit)]
    expected, whose, joint = kind or "", "", None
    if match := _JOINT_COLUMN.fullmatch(name):
        joint = joints[int(match[2]) - 1]
        expected = (_ROTARY if joint.type == "revolute" else _LINEAR).get(expected, expected)
        whose = f" (joint {match[2]} is {joint.type})"
    if dimension == "current" and re.fullmatch(r"tau\d+", name) and joint is not None:
        if joint.torque_constant is None:
            fail(f"{name} is a current [{unit}], but joint {name[3:]} of the model has no torque_constant; add it")
        return Column(name, index, factor * joint.torque_constant, 0.0)
    if dimension != expected:
        article = "an" if expected[0] in "aeiou" else "a"
        fail(
            f"{name} is in [{unit}]; expected {article} {expected} such as {' or '.join(OFFERED[expected][:2])}{whose}"
        )
    return Column(name, index, factor, offset)


@dataclass(frozen=True)
class AllowedLaw:
    """A law of a drive for which a recording has the columns.

    columns   those that it would read     missing   gains that must stand for a column
    """

    law: DriveLaw
    columns: tuple[str, ...]
    missing: tuple[str, ...]

    @property
    def complete(self) -> bool:
        return not self.missing


def laws_of(signals: Collection[str], joint: int) -> list[AllowedLaw]:
    """Laws of a drive all of whose columns are among these signals of a joint, but for those that a gain may state."""
    there = [signal for signal in COMMANDS if numbered_signal(signal).format(joint) in signals]
    found, stand_ins = [], set[str]()
    for law in LAWS.values():
        sources = {signal: law.source(signal, there, {}) for signal in (*law.reads, *law.also)}
        if all(sources[signal] or signal in law.instead for signal in law.reads):
            columns = tuple(numbered_signal(source).format(joint) for source in sources.values() if source)
            missing = tuple(law.instead[signal][1] for signal in law.reads if not sources[signal])
            stand_ins |= {source for signal, source in sources.items() if source and source != signal}
            found.append(AllowedLaw(law, columns, missing))
    return [allowed for allowed in found if allowed.law.command not in stand_ins]


def _missing(name: str, header: Sequence[str], free: Sequence[str], n: int, read: Collection[str]) -> str:
    """The message for a missing column, with the option to type. free: fields that are not read; read: signals."""
    if header[0] == NUMBERED.format(1):
        return unnamed(len(header), n)
    joints = "" if name == "t" else f" (the model has {n} joint{'s' if n > 1 else ''})"
    if len(header) == 1:
        return f"no column {name}; the first line is {quote(header[0])}; expected names separated by commas"
    if name.startswith("tau") and (laws := laws_of(read, int(name[3:]))):
        law = " or ".join(f'law = "{allowed.law.name}"' for allowed in laws)
        without = [k for k in range(1, n + 1) if f"tau{k}" not in read and laws_of(read, k)]
        return (
            f"no column {name}{joints}; its columns are those of a drive: add [joint.drive] with {law} to "
            f'{joints_said(without)} of the model file; or name the torque with --map {name}="Header [unit]"'
        )
    by_name = {_split(cell)[0]: cell for cell in free}
    close = difflib.get_close_matches(name, by_name, n=1, cutoff=0.5)
    example = by_name[close[0]] if close else "Header [unit]"
    if not free and name.startswith("tau"):
        told = ", ".join(numbered_signal(law.command).format(name[3:]) for law in LAWS.values())
        cure = f"record the torque, or what the drive is told: {told}"
        return f"no column {name}{joints}; the file has {some(header)}; {cure}"
    if not free:
        return f"no column {name}{joints}; the file has {some(header)}, and all are used; use the model of this arm"
    return f"no column {name}{joints}; the file has {some(header)}; name it with --map {name}={quote(example)}"

"""Other programs' names of signals translated to Tendon's: joints by name, one `--map` for all joints, known logs."""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from runtime.recordings import servo_logs
from runtime.recordings.columns import JOINT_SIGNALS, NUMBERED, Fail, fields_meant, numbered_signal, unnamed
from runtime.recordings.contents import Contents, RecordedField, some
from symbolic.model_file.arm import LINK_TORQUE, MOTOR_TORQUE, DescribedJoint, Torque

FAMILY = re.compile(r"(.*?)[_.(\[]?(\d{1,3})[)\]]?", re.DOTALL)
"""A name and its number: actual_q_0, q[0], tau1."""
_OURS = re.compile(rf"(?:{JOINT_SIGNALS})\d{{1,3}}(?:_desired|_link|_rigid)?|t|run|[fm][xyz]", re.ASCII)
_WHOLE = re.compile(rf"({JOINT_SIGNALS})((?:_desired|_link|_rigid)?)", re.ASCII)
"""A signal without a joint's number: `--map` then maps it for all joints."""


@dataclass(frozen=True)
class KnownLog:
    """The logs of a program.

    signature   fields by which its logs are recognised
    signals     its name of a field, {} for the joint's number -> Tendon's name and unit
    first       number of its first joint
    note        what users should know about its signals
    torque      what its torques are
    """

    name: str
    signature: frozenset[str]
    signals: Mapping[str, str]
    first: int
    note: str
    torque: Torque


KNOWN_LOGS = (
    KnownLog(
        "Universal Robots' RTDE recorder",
        frozenset(("timestamp", "actual_q_0")),
        {
            "timestamp": "t [s]",
            "actual_q_{}": "q{} [rad]",
            "actual_qd_{}": "qd{} [rad/s]",
            "target_q_{}": "q{}_desired [rad]",
            "actual_current_{}": "tau{} [A]",
            "joint_temperatures_{}": "temperature{} [degC]",
        },
        first=0,
        note="tau is actual_current in A; the joints' torque_constant converts it to a torque",
        torque=MOTOR_TORQUE,
    ),
    KnownLog(
        "libfranka's log",
        frozenset(("q[0]", "dq[0]", "tau_J[0]")),
        {
            "duration": "t [ms]",
            "time": "t [ms]",
            "q[{}]": "q{} [rad]",
            "dq[{}]": "qd{} [rad/s]",
            "q_d[{}]": "q{}_desired [rad]",
            "tau_J[{}]": "tau{} [N m]",
        },
        first=0,
        note="tau is tau_J, measured behind the gears, so it lacks the friction of motors and gears, and the rotors",
        torque=LINK_TORQUE,
    ),
)
"""Source: RTDE client library, example record.py; libfranka, logToCSV."""


@dataclass(frozen=True)
class Understood:
    """A file's names, translated.

    known     Tendon's name of every field, or the file's where it is not understood
    mapping   `--map` with one entry for each joint
    notes     assumptions that users should know
    log       the known log that it is and whose torques are read
    """

    known: tuple[str, ...]
    mapping: Mapping[str, str]
    notes: tuple[str, ...] = ()
    log: KnownLog | None = None


def understood(
    contents: Contents, joints: Sequence[DescribedJoint], mapping: Mapping[str, str], fail: Fail
) -> Understood:
    """Translates the names of a file for these joints. fail: raises RecordingError with the file's name."""
    spread = _spread(contents.fields, joints, mapping, fail)
    if any(field.signal for field in contents.fields):
        known, notes = _by_joint(contents, joints, spread, fail)
        return Understood(known, spread, notes)
    if log := _known_log(contents.fields):
        if "tau1" in spread:
            return Understood(_translated(contents.fields, log), spread)
        notes = (f"read as {log.name}: {log.note}",)
        return Understood(_translated(contents.fields, log), spread, notes, log)
    if servos := servo_logs.translated(contents, fail):
        return Understood(servos[0], spread, servos[1:])
    return Understood(_last_parts(contents.fields), spread)


def count_joints(contents: Contents, mapping: Mapping[str, str], fail: Fail) -> int:
    """Number of joints that the file or the mapping names (q1, q2, …), at least one."""
    if contents.fields and contents.fields[0].name == NUMBERED.format(1) and not {"q", "q1"} & set(mapping):
        fail(unnamed(len(contents.fields)))
    family = mapping.get("q")
    if family is not None:
        return max(1, len(_members(family, contents.fields)[0]))
    if "q1" not in mapping and any(field.signal for field in contents.fields):
        clock = _clock_of("q", contents.fields, (), fail)
        return max(1, sum(field.signal == "q" and field.clock == clock for field in contents.fields))
    log = _known_log(contents.fields)
    servos = None if log else servo_logs.translated(contents, fail)
    known = _translated(contents.fields, log) if log else servos[0] if servos else _last_parts(contents.fields)
    named = {cell.split("[")[0].strip().lower() for cell in known} | set(mapping)
    numbers = itertools.takewhile(lambda k: {f"q{k}", f"tau{k}"} & named, itertools.count(1))
    return max(1, sum(1 for _ in numbers))


def bare(name: str) -> str:
    """A field's name without its unit."""
    return re.sub(r"\s*\[(?!\d+\])[^\[\]]*\]\s*$", "", name.strip())


# --- one entry of --map for all joints ---


def _spread(
    fields: Sequence[RecordedField], joints: Sequence[DescribedJoint], mapping: Mapping[str, str], fail: Fail
) -> dict[str, str]:
    """`q=actual_q` as q1=actual_q_0, q2=actual_q_1, …; entries for single joints stay, and take precedence."""
    found: dict[str, str] = {}
    for name, wanted in mapping.items():
        whole = _WHOLE.fullmatch(name.strip())
        if whole is None:
            continue
        members, sign, unit = _members(wanted, fields)
        if len(members) < len(joints):
            fail(
                f"--map {name}: {len(members)} columns are called {bare(wanted)} with a number; expected one for each "
                f"of {len(joints)} joints; the file has {some([f.name for f in fields])}"
            )
        ordered = _named(members, [joint.name for joint in joints]) or members
        for number, member in enumerate(ordered[: len(joints)], 1):
            found[f"{whole[1]}{number}{whole[2]}"] = f"{sign}{member.name if not unit else bare(member.name) + unit}"
    return found | {name: wanted for name, wanted in mapping.items() if not _WHOLE.fullmatch(name.strip())}


def _members(wanted: str, fields: Sequence[RecordedField]) -> tuple[list[RecordedField], str, str]:
    sign = "-" if wanted.strip().startswith("-") else ""
    base = bare(wanted.strip().removeprefix("-"))
    unit = wanted.strip().removeprefix("-")[len(base) :].strip()
    return members(base, fields), sign, f" {unit}" if unit else ""


def members(base: str, fields: Sequence[RecordedField]) -> list[RecordedField]:
    """The fields with a common name, a number or a joint's name apart, in the order of their numbers."""
    numbered: list[tuple[int, RecordedField]] = []
    for place, field in enumerate(fields):
        name = bare(field.name)
        if field.joint is not None and name.endswith(f".{field.joint}") and field.signal != "t":
            stem, number = name.removesuffix(f".{field.joint}"), place
        elif match := FAMILY.fullmatch(name):
            stem, number = match[1], int(match[2])
        else:
            continue
        if stem == base or stem.endswith((f".{base}", f"/{base}")):
            numbered.append((number, field))
    return [field for _, field in sorted(numbered, key=lambda pair: pair[0])]


# --- formats that define signals and joints ---


def _by_joint(
    contents: Contents, joints: Sequence[DescribedJoint], mapping: Mapping[str, str], fail: Fail
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Tendon's names of fields whose format defines signal and joint, and the assumptions made."""
    fields = contents.fields
    known, notes = [field.name for field in fields], []
    chosen = fields_meant(mapping["q1"], known) if "q1" in mapping else []
    home = fields[chosen[0]].clock if chosen else _clock_of("q", fields, joints, fail)
    order = _joints_mapped(fields, known, mapping, len(joints))
    for signal in dict.fromkeys(field.signal for field in fields if field.signal not in (None, "t", "run")):
        name = numbered_signal(signal)
        if name.format(1) in mapping:
            continue
        clocks = {field.clock for field in fields if field.signal == signal}
        clock = home if home in clocks or signal != "tau" else _clock_of(signal, fields, joints, fail)
        members = [field for field in fields if field.signal == signal and field.clock == clock]
        ordered = _named(members, [joint.name for joint in joints]) or _named(members, order)
        if ordered is None:
            ordered = members
            if len(members) > len(joints):
                fail(
                    f"has {len(members)} joints, {some([str(m.joint) for m in members])}, and the model {len(joints)} "
                    "with other names; name them in the model file, or the fields with "
                    f'--map {name.format(1)}="{members[0].name}"'
                )
            if signal == "q" and len(members) > 1:
                listed = ", ".join(f"{k} {member.joint}" for k, member in enumerate(members, 1))
                notes.append(f"joints in the order of the file: {listed}")
        for number, member in enumerate(ordered, 1):
            index = fields.index(member)
            known[index] = name.format(number) + known[index].removeprefix(bare(known[index]))
    known = ["run" if field.signal == "run" else ours for field, ours in zip(fields, known, strict=True)]
    if home is not None and mapping.get("t") is None and home in contents.times:
        known[contents.times[home]] = "t [s]"
    return tuple(known), tuple(notes)


def _clock_of(signal: str, fields: Sequence[RecordedField], joints: Sequence[DescribedJoint], fail: Fail) -> str | None:
    """The clock of a signal of these joints, preferably one that has torques too; None if no field is this signal."""
    there: dict[str, list[RecordedField]] = {}
    for field in fields:
        if field.signal == signal:
            there.setdefault(field.clock, []).append(field)
    clocks = [
        clock for clock, members in there.items() if joints and _named(members, [j.name for j in joints])
    ] or list(there)
    both = [clock for clock in clocks if any(f.signal == "tau" and f.clock == clock for f in fields)]
    choice = both or clocks
    if len(choice) > 1:
        stems = (there[clock][0].name.removesuffix(f".{there[clock][0].joint}") for clock in choice[:2])
        examples = " or ".join(f'--map {signal}="{stem}"' for stem in stems)
        fail(f"{some(choice)} all have {signal}; choose one with {examples}")
    return choice[0] if choice else None


def _named(members: Sequence[RecordedField], joints: Sequence[str | None]) -> list[RecordedField] | None:
    """The fields in the order of these names of joints; None unless all match."""
    there = {field.joint: field for field in members if field.joint is not None}
    ordered = [there.get(name) if name else None for name in joints]
    known = [field for field in ordered if field is not None]
    return known if known and len(known) == len(joints) else None


def _joints_mapped(
    fields: Sequence[RecordedField], names: Sequence[str], mapping: Mapping[str, str], n: int
) -> list[str | None]:
    """Names of the joints whose positions `--map` names, so that their other signals follow; empty if it names none."""
    chosen = [fields_meant(mapping.get(f"q{k}", ""), names) for k in range(1, n + 1)]
    return [fields[hits[0]].joint for hits in chosen] if all(chosen) else []


# --- formats that do not ---


def _known_log(fields: Sequence[RecordedField]) -> KnownLog | None:
    names = {_last(field.name) for field in fields}
    return next((log for log in KNOWN_LOGS if log.signature <= names), None)


def _last(name: str) -> str:
    return re.split(r"[./]", bare(name))[-1]


def _translated(fields: Sequence[RecordedField], log: KnownLog) -> tuple[str, ...]:
    """Tendon's names of a known log's fields; of several fields with one name, the first."""
    seen: set[str] = set()
    known = []
    for field in fields:
        name = _last(field.name)
        pattern, number = re.sub(r"\d+", "{}", name), re.search(r"\d+", name)
        ours = log.signals.get(pattern, "")
        ours = ours.format(int(number[0]) - log.first + 1) if number else ours
        known.append(field.name if not ours or ours in seen else ours)
        seen.add(ours)
    return tuple(known)


def _last_parts(fields: Sequence[RecordedField]) -> tuple[str, ...]:
    parts = [re.split(r"[./]", field.name.strip())[-1] for field in fields]
    counts = {part: parts.count(part) for part in set(parts) if _OURS.fullmatch(bare(part))}
    return tuple(part if counts.get(part) == 1 else field.name for part, field in zip(parts, fields, strict=True))

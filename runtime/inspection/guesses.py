"""Guesses from the names of fields, and from their values, which signal they are and in which unit."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from math import pi

from runtime.inspection.settings import MANY_TURNS
from runtime.recordings.columns import UNITS, MappedColumn, RecordedArm, normal_unit, signals_of, units_of
from runtime.recordings.contents import RecordedField, map_option
from runtime.recordings.names import FAMILY, bare, members
from runtime.recordings.preview import FieldPreview
from runtime.recordings.settings import SLOWEST_STEP

_WORDS: Mapping[str, str] = {
    "t": r"t|time|times|timestamp|stamp|sec|seconds|zeit",
    "qd": r"qd|dq|vel|velocity|velocities|speed|omega|rpm|geschwindigkeit",
    "tau": r"tau|torque|torques|effort|efforts|moment|current|currents|iq|nm|strom|drehmoment",
    "q": r"q|pos|position|positions|angle|angles|theta|phi|encoder|enc|joint|winkel|deg|rad",
}
"""Signal -> words for it in names of fields, the most specific first."""
_NOT_MEASURED = re.compile(r"ref|des|cmd|command|target|err|error|set|ff|init|goal|action", re.IGNORECASE)
_MEASURED = re.compile(r"act|actual|meas|measured|mot|motor", re.IGNORECASE)
_UNIT_WORDS: Sequence[tuple[str, str]] = (
    (r"deg_per_s|degps|deg_s", "deg/s"),
    (r"rad_per_s|radps|rad_s", "rad/s"),
    (r"rpm", "rpm"),
    (r"deg|degrees", "deg"),
    (r"ms|msec|milliseconds", "ms"),
    (r"us|usec", "us"),
    (r"ns|nsec|nanoseconds", "ns"),
    (r"m_?a|milliamps", "mA"),
    (r"m_?nm", "mN m"),
    (r"amps|current|iq|(?:current|strom|iq?)(?:_\w+)?_a", "A"),
)
"""Words at the end of a name, with _ before capitals -> unit. A single "a" may be a joint's name."""


def map_options(fields: Sequence[RecordedField], missing: str) -> list[str]:
    """Suggested options for missing positions, torques and time: '--map q="act_pos_mot_deg [deg]"'.

    One option for all joints where their fields differ only in a number. missing: the first signal that is missing, in
    the order of `needed_of`: those before it are there
    """
    found = []
    named = {signal for signal in _WORDS if any(re.fullmatch(rf"{signal}1?", bare(f.name)) for f in fields)}
    open_ones = {"t": ("q", "tau", "t"), "q": ("q", "tau"), "tau": ("tau",)}.get(missing.rstrip("0123456789"), ())
    for signal, best in _likely([s for s in open_ones if s not in named], fields):
        stem, several = _family(best, fields)
        unit = unit_in_name(best.name)
        if several or signal == "t":
            options = {signal: stem if several else bare(best.name)}
        else:
            options = {f"{signal}{k}": bare(name) for k, name in enumerate(_alike(best.name, fields), 1)}
        found += [map_option({}, name, field, unit or "") for name, field in options.items()]
    return found


def guesses(previews: Sequence[FieldPreview], arm: RecordedArm) -> dict[str, MappedColumn]:
    """The column of each signal of an arm that the names of the fields suggest, with the unit that name or values
    suggest where the file states none."""
    fields, found = [preview.field for preview in previews], dict[str, str]()
    own = {bare(field.name): bare(field.name) for field in fields}
    for signal, best in _likely(["q", "tau", "qd", "t"], [p.field for p in previews if p.samples]):
        names = [best.name] if signal == "t" else _of_joints(best, fields)
        for k, name in enumerate(names[: len(arm.joints)], 1):
            found["t" if signal == "t" else f"{signal}{k}"] = name
    found |= {name: own[name] for name in signals_of(arm) if name in own}
    by_name = {preview.field.name: preview for preview in previews}
    by_name |= {bare(preview.field.name): preview for preview in previews}
    cells = {signal: MappedColumn(bare(name), _unit(signal, by_name[name], arm)) for signal, name in found.items()}
    for k in range(1, len(arm.joints) + 1):
        q, qd = cells.get(f"q{k}"), cells.get(f"qd{k}")
        if (
            q is not None
            and qd is not None
            and q.unit == "deg"
            and not qd.unit
            and bare(found[f"qd{k}"]) == found[f"qd{k}"]
        ):
            cells[f"qd{k}"] = MappedColumn(qd.name, "deg/s")  # a log has its rates in the unit of its positions
    return cells


def alike(name: str, names: Sequence[str]) -> list[str]:
    """The names that differ from one only in a number, in the order of that number: the same signal of all joints."""
    return [bare(found) for found in _of_joints(RecordedField(name), [RecordedField(other) for other in names])]


def _of_joints(best: RecordedField, fields: Sequence[RecordedField]) -> list[str]:
    stem, several = _family(best, fields)
    return [field.name for field in members(stem, fields)] if several else _alike(best.name, fields)


def _unit(signal: str, preview: FieldPreview, arm: RecordedArm) -> str:
    """The unit in which a field may be where the file states none; "": SI."""
    name = preview.field.name
    if bare(name) != name.strip():
        return ""
    offered = units_of(signal, arm)
    said = unit_in_name(name)
    if said in offered:
        return said or ""
    spread = preview.largest - preview.least
    if signal == "t":
        step = spread / max(preview.samples - 1, 1)
        likely = next((unit for unit in offered if step * UNITS[unit][1] <= SLOWEST_STEP), "")
        return "" if likely == offered[0] else likely
    turns = signal.startswith("q") and not signal.startswith("qd") and "deg" in offered
    return "deg" if turns and spread > MANY_TURNS * 2 * pi else ""


def _likely(signals: Sequence[str], fields: Sequence[RecordedField]) -> Iterator[tuple[str, RecordedField]]:
    """For each of these signals the field whose name suggests it most, all of one clock."""
    home = None
    for signal in signals:
        candidates = [f for f in fields if _signal_in_name(f.name) == signal and (home is None or f.clock == home)]
        if candidates:
            best = max(
                candidates, key=lambda f: 2 * len(_MEASURED.findall(f.name)) - 3 * len(_NOT_MEASURED.findall(f.name))
            )
            home = home or best.clock
            yield signal, best


def _parts(name: str) -> list[str]:
    spread = re.sub(r"([a-z])([A-Z])", r"\1 \2", bare(name))
    return [word for word in re.split(r"[^a-zA-Z]+", spread.lower()) if word]


def _signal_in_name(name: str) -> str | None:
    parts = _parts(name)
    return next((s for s, words in _WORDS.items() if any(re.fullmatch(words, part) for part in parts)), None)


def _family(best: RecordedField, fields: Sequence[RecordedField]) -> tuple[str, bool]:
    """The name of a field without its joint's number, and whether there are others of this name."""
    if best.joint is not None and best.name.endswith(f".{best.joint}"):
        return best.name.removesuffix(f".{best.joint}"), True
    match = FAMILY.fullmatch(bare(best.name))
    if match is None:
        return best.name, False
    like = [f for f in fields if (m := FAMILY.fullmatch(bare(f.name))) and m[1] == match[1]]
    return match[1], len(like) > 1


def _alike(best: str, fields: Sequence[RecordedField]) -> list[str]:
    """The names that differ from one only in one number, in the order of that number."""
    for number in re.finditer(r"\d+", best):
        like = re.compile(re.escape(best[: number.start()]) + r"(\d{1,3})" + re.escape(best[number.end() :]))
        found = {int(m[1]): f.name for f in fields if (m := like.fullmatch(f.name))}
        if len(found) > 1:
            return [found[k] for k in sorted(found)]
    return [best]


def unit_in_name(name: str) -> str | None:
    """The unit at the end of a name that has none in brackets."""
    if "[" in name and not re.search(r"\[\d+\]", name):
        return None
    if (bracket := re.search(r"\(([^()]*)\)\s*$", name)) and normal_unit(bracket[1]) in UNITS:
        return None
    ending = "_".join(_parts(name))
    return next((unit for words, unit in _UNIT_WORDS if re.search(rf"(?:^|_)(?:{words})$", ending)), None)

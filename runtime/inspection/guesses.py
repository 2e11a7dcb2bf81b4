"""What fields of other names may be, by the words in their names: options to be typed, never believed unasked."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from runtime.recordings.columns import UNITS, normal_unit
from runtime.recordings.contents import RecordedField

_WORDS: Mapping[str, str] = {
    "t": r"t|time|times|timestamp|stamp|sec|seconds|zeit",
    "qd": r"qd|dq|vel|velocity|velocities|speed|omega|rpm|geschwindigkeit",
    "tau": r"tau|torque|torques|effort|efforts|moment|current|currents|iq|nm|strom|drehmoment",
    "q": r"q|pos|position|positions|angle|angles|theta|phi|encoder|enc|joint|winkel|deg|rad",
}
"""Our signal -> words of others for it, the most telling first."""
_NOT_MEASURED = re.compile(r"ref|des|cmd|command|target|err|error|set|ff|init|goal|action", re.IGNORECASE)
_MEASURED = re.compile(r"act|actual|meas|measured|mot|motor", re.IGNORECASE)
_UNITS: Sequence[tuple[str, str]] = (
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
"""Words at the end of a name, with _ before its capitals -> the unit that they mean. A joint may be called a."""
_NUMBERED = re.compile(r"(.*?)[_.(\[]?(\d{1,3})[)\]]?", re.DOTALL)


def options(fields: Sequence[RecordedField]) -> list[str]:
    """Options for positions, torques and time that no field is called: '--map q="act_pos_mot_deg [deg]"'.

    One family of fields for all joints where there is one.
    """
    found, home = [], None
    for signal in ("q", "tau", "t"):
        if any(re.fullmatch(rf"{signal}1?", _bare(f.name)) for f in fields):
            continue
        candidates = [f for f in fields if _signal(f.name) == signal and (home is None or f.clock == home)]
        if not candidates:
            continue
        best = max(candidates, key=lambda f: _score(f.name))
        home = home or best.clock
        stem, several = _family(best, fields)
        unit = unit_in_name(best.name)
        if several or signal == "t":
            named = {signal: stem if several else _bare(best.name)}
        else:
            named = {f"{signal}{k}": _bare(name) for k, name in enumerate(_alike(best.name, fields), 1)}
        found += [f'--map {name}="{field}{f" [{unit}]" if unit else ""}"' for name, field in named.items()]
    return found


def _parts(name: str) -> list[str]:
    spread = re.sub(r"([a-z])([A-Z])", r"\1 \2", _bare(name))
    return [word for word in re.split(r"[^a-zA-Z]+", spread.lower()) if word]


def _bare(name: str) -> str:
    return re.sub(r"\s*\[\D[^\[\]]*\]\s*$", "", name.strip())


def _signal(name: str) -> str | None:
    parts = _parts(name)
    return next((s for s, words in _WORDS.items() if any(re.fullmatch(words, part) for part in parts)), None)


def _score(name: str) -> int:
    return 2 * len(_MEASURED.findall(name)) - 3 * len(_NOT_MEASURED.findall(name))


def _family(best: RecordedField, fields: Sequence[RecordedField]) -> tuple[str, bool]:
    """The name of a field without its joint, and whether other joints have the like."""
    if best.joint is not None:
        return best.name.removesuffix(f".{best.joint}"), True
    match = _NUMBERED.fullmatch(_bare(best.name))
    if match is None:
        return best.name, False
    like = [f for f in fields if (m := _NUMBERED.fullmatch(_bare(f.name))) and m[1] == match[1]]
    return match[1], len(like) > 1


def _alike(best: str, fields: Sequence[RecordedField]) -> list[str]:
    """The names that differ from one in one number alone, in the order of that number; itself alone if none do."""
    for number in re.finditer(r"\d+", best):
        like = re.compile(re.escape(best[: number.start()]) + r"(\d{1,3})" + re.escape(best[number.end() :]))
        found = {int(m[1]): f.name for f in fields if (m := like.fullmatch(f.name))}
        if len(found) > 1:
            return [found[k] for k in sorted(found)]
    return [best]


def unit_in_name(name: str) -> str | None:
    """The unit that a name ends in, where it states none in brackets."""
    if "[" in name and not re.search(r"\[\d+\]", name):
        return None
    if (bracket := re.search(r"\(([^()]*)\)\s*$", name)) and normal_unit(bracket[1]) in UNITS:
        return None
    ending = "_".join(_parts(name))
    return next((unit for words, unit in _UNITS if re.search(rf"(?:^|_)(?:{words})$", ending)), None)

"""Logs of hobby servos: columns with the names of a Dynamixel's or a Feetech's registers, in steps of the registers.

Source: ROBOTIS e-Manual, control tables of the X series; Feetech, memory table of the STS3215.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from runtime.recordings.columns import Fail, numbered_signal, stated_unit
from runtime.recordings.contents import Contents, map_option
from symbolic.model_file.checks import quote


@dataclass(frozen=True)
class _Register:
    """A register: its signal, the units of its steps, and the bits of its number.

    signed   where a Feetech has the sign; a Dynamixel counts in two's complement, of as many bits
    """

    signal: str
    dynamixel: str
    feetech: str
    bits: int
    signed: int


_VELOCITY = _Register("qd", "0.229 rpm", "tick4096/s", 32, 15)
_VOLTAGE = _Register("bus_voltage", "0.1 V", "0.1 V", 16, 15)
_REGISTERS = {
    "present_position": _Register("q", "tick4096", "tick4096", 32, 15),
    "goal_position": _Register("q_desired", "tick4096", "tick4096", 32, 15),
    "present_velocity": _VELOCITY,
    "present_speed": _VELOCITY,
    "present_current": _Register("current", "2.69 mA", "6.5 mA", 16, 15),
    "present_pwm": _Register("duty", "0.113 %", "0.1 %", 16, 10),
    "present_load": _Register("duty", "0.1 %", "0.1 %", 16, 10),
    "present_input_voltage": _VOLTAGE,
    "present_voltage": _VOLTAGE,
    "present_temperature": _Register("temperature", "degC", "degC", 8, 7),
}
_OF_DYNAMIXEL = frozenset(("present_pwm", "present_input_voltage"))
_OF_FEETECH = frozenset(("present_speed", "present_load", "present_voltage"))
_NUMBER = re.compile(r"(?:dxl_|servo_|motor_)?id")
_TIME = re.compile(r"(?:time|times|timestamp|elapsed|elapsed_time|t)(?:_(s|sec|seconds|ms|us|ns))?")


@dataclass(frozen=True)
class _Found:
    """A column of a register: its place in the file, and the number of its servo, None without one."""

    index: int
    register: str
    servo: int | None

    @property
    def signal(self) -> str:
        return _REGISTERS[self.register].signal


def translated(contents: Contents, fail: Fail) -> tuple[tuple[str, ...], str] | None:
    """Tendon's names of a servo log's fields, with their units, and a note of what was taken for what.

    None if it is no such log: no positions of servos, or positions with decimals, which a script has converted.
    fail: raises RecordingError for numbers that were read without their sign
    """
    found = [f for index, field in enumerate(contents.fields) if (f := _register(index, field.name)) is not None]
    positions = [f for f in found if f.register == "present_position"]
    bare = [f for f in found if stated_unit(contents.fields[f.index].name) is None]
    if not positions or len({contents.fields[f.index].clock for f in found}) > 1:
        return None
    _refuse_rows_of_servos(contents, fail)
    names = {f.register for f in found}
    feetech = not names & _OF_DYNAMIXEL and bool(names & _OF_FEETECH)
    if bare and not _are_steps(contents, bare, feetech, fail):
        return None
    servos = sorted({f.servo for f in positions}, key=lambda servo: servo or 0)
    known, seen, taken = [field.name for field in contents.fields], set[str](), dict[str, str]()
    for f in found:
        register, name = _REGISTERS[f.register], contents.fields[f.index].name
        number = servos.index(f.servo) + 1 if f.servo in servos else 0
        ours = numbered_signal(f.signal).format(number)
        unit = stated_unit(name) or (register.feetech if feetech else register.dynamixel)
        if number and ours not in seen:
            known[f.index] = f"{ours} [{unit}]"
            seen.add(ours)
            taken.setdefault(f.register, f"{f.register.replace('_', ' ')} in {unit}")
    for index, field in enumerate(contents.fields):
        if (match := _TIME.fullmatch(_words(field.name))) and "t" not in seen:
            known[index] = f"t [{stated_unit(field.name) or match[1] or 's'}]"
            seen.add("t")
    return tuple(known), _note(contents, found, servos, list(taken.values()), feetech)


def _note(
    contents: Contents, found: Sequence[_Found], servos: Sequence[int | None], taken: Sequence[str], feetech: bool
) -> str:
    who = "Feetech" if feetech else "Dynamixel"
    joints = f"; servos {', '.join(map(str, servos))} are the joints in this order" if len(servos) > 1 else ""
    note = f"read as registers of {who} servos: {', '.join(taken)}; position 2048 is 0{joints}"
    currents = [f for f in found if f.register == "present_current"]
    if currents and stated_unit(name := contents.fields[currents[0].index].name) is None:
        option = map_option({}, "current1", name.strip(), "mA" if not feetech else "A")
        note += f"; if the current of this model has another step: {option}"
    return note


def _words(name: str) -> str:
    unit = stated_unit(name)
    plain = name if unit is None else name.strip()[: -len(unit) - 2]
    spread = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", plain)
    return re.sub(r"[^a-z0-9]+", "_", spread.lower()).strip("_")


def _register(index: int, name: str) -> _Found | None:
    words = _words(name)
    register = next((r for r in _REGISTERS if re.search(rf"(?:^|_){r}(?:_|\d|$)", words)), None)
    if register is None:
        return None
    number = re.search(r"\d{1,3}", words.replace(register, "", 1))
    return _Found(index, register, int(number[0]) if number else None)


def _refuse_rows_of_servos(contents: Contents, fail: Fail) -> None:
    """Refuses a log with a row for each servo, which it names in a column of its own."""
    index = next((k for k, f in enumerate(contents.fields) if _NUMBER.fullmatch(_words(f.name))), None)
    if index is None:
        return
    servos = np.unique(contents.load({"servo": index}).signals["servo"])
    if len(servos) > 1:
        example = f"Present Position {servos[0]:g},Present Position {servos[1]:g}"
        fail(f"has the samples of {len(servos)} servos in rows of their own; write a column for each: {example}")


def _are_steps(contents: Contents, found: Sequence[_Found], feetech: bool, fail: Fail) -> bool:
    """Whether all numbers of these columns are whole; those that lost their sign are refused."""
    samples = contents.load({str(f.index): f.index for f in found})
    for f in found:
        values = samples.signals[str(f.index)]
        values = values[np.isfinite(values)]
        if (values != np.round(values)).any():
            return False
        register = _REGISTERS[f.register]
        sign = 2 ** (register.signed if feetech else register.bits - 1)
        if len(values) and values.max() >= sign and register.signal != "temperature":
            right = f"{sign} - value" if feetech else f"value - {2 * sign}"
            fail(
                f"{quote(contents.fields[f.index].name)} reaches {values.max():.0f}, a negative number that was read "
                f"without its sign; write what is over {sign - 1} as {right}"
            )
    return True

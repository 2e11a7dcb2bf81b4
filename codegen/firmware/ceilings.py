"""Ceilings of an arm: what its board keeps to whatever a host sends.

They come from the model file, and where it says nothing from the firmware's tendon_board.h, whose numbers are read here
and written nowhere else. Facts of the board (the rate, the encoders' steps) may not be told otherwise either: a guard
that measures in other units guards nothing.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Sequence
from dataclasses import dataclass, fields
from fractions import Fraction
from math import ceil, exp, pi
from pathlib import Path
from typing import Any

from codegen.c.c_code import float32
from codegen.firmware.messages import LEAST_FILTER, RATES, STEPS
from symbolic.model_file.arm import Control, DescribedJoint

OVERSPEED = 2.0
"""Of a joint's limit of speed, which plans keep: a host's guard stands below this, as tracking needs some room."""
BEYOND = {"revolute": 0.1, "prismatic": 0.02}
"""rad, m beyond a joint's range, which plans keep: twice what tracking needs there."""
GAIN_ROOM = 10.0
"""Of the model file's gains: so far they may be tuned without new firmware."""
FACT = 0.05
"""Part by which rate and encoders' steps may differ from the model file's: so far a host lets a timer be off."""
FILTER = 0.5
"""Of the model file's gain of the low-pass on the rates, at least: a slower one would hide speed from the guard."""
HIGHEST = 1e38
"""Of any ceiling: below the float that stands for no limit."""
LATE_PERIODS = 2.0
"""Control periods between two steps that are let pass at least, where they are longer than tendon_board.h's time."""
_MICROSECONDS = 1e6
_BOARD_HEADER = Path(__file__).resolve().parent / "tree" / "src" / "tendon_board.h"
_KINDS = {"revolute": ("TORQUE", "SPEED", "ERROR", "ANGLE"), "prismatic": ("FORCE", "LINEAR_SPEED", "SLIP", "TRAVEL")}
_DEFINED = re.compile(r"^#define (TENDON_MOST_\w+) ([0-9.e+]+)[fU]? ", re.MULTILINE)


@dataclass(frozen=True)
class Ceiling:
    """A number, and how C spells it: the name of one of tendon_board.h, or its digits."""

    value: float
    text: str

    @property
    def of_board(self) -> bool:
        """Whether it is one of tendon_board.h, as the model file says nothing."""
        return self.text.startswith("TENDON_MOST_")

    def __neg__(self) -> Ceiling:
        return Ceiling(-self.value, self.text[1:] if self.text.startswith("-") else f"-{self.text}")


@dataclass(frozen=True)
class JointCeilings:
    """In the order of the C structure; low and high are ends of the range of position, finest and coarsest those of the
    encoder's step."""

    torque_limit: Ceiling
    speed: Ceiling
    tracking: Ceiling
    low: Ceiling
    high: Ceiling
    kp: Ceiling
    kd: Ceiling
    finest: Ceiling
    coarsest: Ceiling

    @classmethod
    def of(cls, joint: DescribedJoint) -> JointCeilings:
        """Of a joint of the model file."""
        torque, speed, tracking, position = (_of_board(name) for name in _KINDS[joint.type])
        limits, beyond = joint.limits, BEYOND[joint.type]
        low, high = -position, position
        if limits.position is not None:
            low, high = _real(limits.position[0] - beyond), _real(limits.position[1] + beyond)
        finest, coarsest = STEPS
        if joint.encoder_counts:
            step = 2.0 * pi / (joint.encoder_counts * joint.gear_ratio)
            finest, coarsest = (1.0 - FACT) * step, (1.0 + FACT) * step
        gains = joint.gains
        return cls(
            torque_limit=torque if limits.torque is None else _real(limits.torque),
            speed=speed if limits.speed is None else _real(OVERSPEED * limits.speed),
            tracking=tracking,
            low=low,
            high=high,
            kp=_real(GAIN_ROOM * gains.kp) if gains and gains.kp else _of_board("KP"),
            kd=_real(GAIN_ROOM * gains.kd) if gains and gains.kd else _of_board("KD"),
            finest=_real(finest),
            coarsest=_real(coarsest),
        )


@dataclass(frozen=True)
class Ceilings:
    """Of an arm. rates: Hz; filter: least gain of the low-pass on the rates; silence: periods; late: us."""

    joints: tuple[JointCeilings, ...]
    rates: tuple[Ceiling, Ceiling]
    filter: Ceiling
    silence: Ceiling
    late: Ceiling

    @classmethod
    def of(cls, joints: Sequence[DescribedJoint], control: Control | None) -> Ceilings:
        """Of the joints and the [controller] of a model file."""
        rates, gain, late = RATES, LEAST_FILTER, _of_board("LATE")
        rate = _of_board("RATE").value
        if control is not None:
            rate = control.rate
            rates = ((1.0 - FACT) * rate, (1.0 + FACT) * rate)
            gain = FILTER * (1.0 - exp(-2.0 * pi * control.velocity_cutoff / rate))
            periods = ceil(LATE_PERIODS / rate * _MICROSECONDS)
            late = _whole(periods) if periods > late.value else late
        return cls(
            joints=tuple(JointCeilings.of(joint) for joint in joints),
            rates=(_real(rates[0]), _real(rates[1])),
            filter=_real(gain),
            silence=_whole(ceil(_of_board("SILENCE").value / _MICROSECONDS * rate)),
            late=late,
        )

    def document(self) -> dict[str, Any]:
        """Of protocol.json: by the names of the fields in `drive` and `safety` that they hold for."""
        page: dict[str, Any] = {
            field.name: [getattr(joint, field.name).value for joint in self.joints]
            for field in fields(JointCeilings)
            if field.name not in ("finest", "coarsest")
        }
        return page | {
            "silence": int(self.silence.value),
            "late": int(self.late.value),
            "rate": [end.value for end in self.rates],
            "velocity_gain": self.filter.value,
            "position_per_count": [[joint.finest.value, joint.coarsest.value] for joint in self.joints],
        }

    def rows(self) -> list[str]:
        """The C structure of each joint."""
        return [
            "{" + ", ".join(getattr(joint, field.name).text for field in fields(JointCeilings)) + "}"
            for joint in self.joints
        ]


def _real(value: float) -> Ceiling:
    """The float nearest to it, which is what a host's message brings for the same value."""
    nearest: float = struct.unpack("<f", struct.pack("<f", min(max(value, -HIGHEST), HIGHEST)))[0]
    return Ceiling(nearest, float32(Fraction(nearest)))


def _whole(value: int) -> Ceiling:
    return Ceiling(value, f"{value}U")


def _of_board(name: str) -> Ceiling:
    """A number of tendon_board.h. Raises KeyError."""
    name = f"TENDON_MOST_{name}"
    return Ceiling(float(dict(_DEFINED.findall(_BOARD_HEADER.read_text(encoding="utf-8")))[name]), name)

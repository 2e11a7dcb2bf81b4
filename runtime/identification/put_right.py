"""Mistakes in a recording as a person is told of them: what was found, and what to type against all of them at once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from runtime.identification.factors import DEGREES, MOTOR, RATIO, ByFactor
from runtime.identification.identify import Identification
from runtime.identification.readings import POSITION, TORQUE, Reading, turns
from runtime.recordings.columns import UNITS, normal_unit
from runtime.recordings.contents import in_unit, map_option, negated
from runtime.wording import number

Array = NDArray[np.float64]
Errors = tuple[Array, Array]
"""(n,) relative errors of the torques as recorded, and put right."""


@dataclass(frozen=True)
class Suspicion:
    """Something about the data that must be put right first. joint: 1-based; kind: in a word; cure: what to type.

    maps   the options in the cure, which hold with those of all other suspicions that are told with it
    """

    joint: int
    kind: str
    found: str
    cure: str
    maps: tuple[str, ...] = ()

    def __str__(self) -> str:
        return f"joint {self.joint}: {self.found}; {self.cure}"


def told(
    identification: Identification,
    reading: Reading,
    errors: Errors | None,
    by_factor: Mapping[int, ByFactor],
    alike: frozenset[int] = frozenset(),
) -> tuple[Suspicion, ...]:
    """All that is wrong where the data should be read so, an item for each joint and mistake.

    errors      None where nothing was put right but by factors
    by_factor   of joints (0-based), what their inertia tells besides
    alike       those whose positions, in degrees, may as well be the motor's
    """
    voice = _Voice(identification, reading, errors, by_factor=by_factor, alike=alike)
    given = Reading.given(identification.model.n)
    if reading == given and not by_factor:
        return ()
    found = [voice.sign(i) for i, sign in enumerate(reading.signs) if sign < 0]
    found += [voice.degrees(i) for i in sorted(voice.in_degrees)]
    found += [voice.motor(i) for i in sorted(voice.at_motors)]
    found += [voice.exchanged(*pair, what) for pair, what in _exchanges(reading)]
    found += [voice.unit_of(i) for i in sorted(voice.unit)]
    found += [voice.ratio(i) for i, factor in sorted(by_factor.items()) if RATIO in factor.kinds]
    return tuple(found)


def _exchanges(reading: Reading) -> list[tuple[tuple[int, int], tuple[str, ...]]]:
    """Joints (0-based) in each other's place, and of what."""
    found: dict[tuple[int, int], tuple[str, ...]] = {}
    for what, places in ((POSITION, reading.positions), (TORQUE, reading.torques)):
        for i, source in enumerate(places):
            if i < source:
                found[i, source] = (*found.get((i, source), ()), what)
    return sorted(found.items())


class _Voice:
    """Words for each mistake, and the options that put right what is wrong with a signal altogether."""

    def __init__(
        self,
        identification: Identification,
        reading: Reading,
        errors: Errors | None,
        by_factor: Mapping[int, ByFactor],
        alike: frozenset[int],
    ) -> None:
        self.motion, self.joints, self.reading = identification.motion, identification.model.joints, reading
        self.errors, self.by_factor, self.alike = errors, by_factor, alike
        self.in_degrees = reading.degrees | {i for i, factor in by_factor.items() if DEGREES in factor.kinds}
        self.at_motors = reading.motors | {i for i, factor in by_factor.items() if MOTOR in factor.kinds}
        self.unit = {i: self._unit(i) for i, factor in by_factor.items() if {"milli", "current"} & set(factor.kinds)}
        self.alone = (
            sum(map(bool, (min(reading.signs) < 0, reading.degrees or reading.motors, _exchanges(reading)))) == 1
        )

    def position(self, joint: int) -> str:
        """What to type for a joint's position (0-based)."""
        source = f"q{self.reading.positions[joint] + 1}"
        cell = self.motion.cells.get(source, source)
        return map_option(f"q{joint + 1}", in_unit(cell, "deg") if joint in self.in_degrees else cell)

    def torque(self, joint: int) -> str:
        """What to type for a joint's torque (0-based)."""
        source = f"tau{self.reading.torques[joint] + 1}"
        cell = self.motion.cells.get(source, source)
        cell = in_unit(cell, self.unit[joint]) if joint in self.unit else cell
        return map_option(f"tau{joint + 1}", negated(cell) if self.reading.signs[joint] < 0 else cell)

    def sign(self, joint: int) -> Suspicion:
        before, after = self._errors(joint)
        said = (
            f"its torque has the wrong sign: as recorded the best fit misses {before} % of it, "
            f"{'turned round' if self.alone else 'with all that is said here put right'} {after} %"
        )
        cure = self.torque(joint)
        expected = f"expected positive where it drives towards positive positions: pass {cure}"
        return Suspicion(joint + 1, "sign", said, cure=expected, maps=(cure,))

    def degrees(self, joint: int) -> Suspicion:
        cure = self.position(joint)
        also = "".join(f"; if {self._instead(kind, joint)}" for kind in self._others(joint, DEGREES))
        said = f"expected radians: if it is in degrees, pass {cure}{also}"
        return Suspicion(joint + 1, "degrees", self._far(joint), cure=said, maps=(cure,))

    def motor(self, joint: int) -> Suspicion:
        kinds = (MOTOR, *self._others(joint, MOTOR))
        said = "; ".join(f"if {self._instead(kind, joint)}" for kind in kinds)
        return Suspicion(joint + 1, "motor", self._far(joint), f"expected the joint's position: {said}")

    def _others(self, joint: int, kind: str) -> tuple[str, ...]:
        """What else may be wrong in the place of a mistake with a joint's position (0-based)."""
        if joint in self.alike:
            return (MOTOR,)
        factor = self.by_factor.get(joint)
        return factor.others if factor is not None and factor.kinds[0] == kind else ()

    def _instead(self, kind: str, joint: int) -> str:
        """A mistake that explains a joint's inertia (0-based), and its cure."""
        k, ratio = joint + 1, f"the gear ratio of {self.joints[joint].gear_ratio:g}"
        if kind == MOTOR:
            return f"it is the motor's, divide q{k}, and qd{k} if it is recorded, by {ratio}"
        if kind == RATIO:
            return f"only the torque is the motor's, multiply tau{k}, or the joint's torque_constant, by {ratio}"
        source = f"q{self.reading.positions[joint] + 1}"
        return f"it is in degrees, pass {map_option(f'q{k}', in_unit(self.motion.cells.get(source, source), 'deg'))}"

    def _far(self, joint: int) -> str:
        """Over how many turns a joint (0-based) is said to move, and what a fit says of that."""
        if joint in self.by_factor:
            said = self._inertia(joint)
        else:
            before, after = self._errors(joint)
            how = "with positions put right" if self.alone else "with all that is said here put right"
            said = f"the best fit misses {before} % of its torque, {how} {after} %"
        return f"its position covers {turns(self.motion, self.reading.positions[joint]):.3g} turns, and {said}"

    def exchanged(self, one: int, other: int, what: tuple[str, ...]) -> Suspicion:
        a, b = one + 1, other + 1
        columns = " and ".join(f"{name}{a}" for name in what)
        said = f"what is recorded as {columns} fits joint {b}, and that of joint {b} fits joint {a}"
        if len(what) == 1:
            said = f"tau{a} follows the motion of joint {b}, and tau{b} that of joint {a}"
        option_of = {POSITION: self.position, TORQUE: self.torque}
        maps = tuple(option_of[name](joint) for name in what for joint in (one, other))
        expected = "expected position and torque of a joint under its own number: pass"
        return Suspicion(a, "exchanged", said, cure=f"{expected} {' '.join(maps)}", maps=maps)

    def unit_of(self, joint: int) -> Suspicion:
        cure, kind = self.torque(joint), "milli" if "milli" in self.by_factor[joint].kinds else "current"
        what = "torque" if self.unit[joint] == "mN m" else "motor's current, for the torque_constant to multiply,"
        said = f"if its {what} is in {self.unit[joint]}, pass {cure}"
        return Suspicion(joint + 1, kind, self._inertia(joint), cure=said, maps=(cure,))

    def ratio(self, joint: int) -> Suspicion:
        ratio = f"{self.joints[joint].gear_ratio:g}"
        cure = (
            f"expected the motor's torque times the gear ratio of {ratio}: multiply tau{joint + 1}, or the joint's "
            "torque_constant, by it"
        )
        return Suspicion(joint + 1, "ratio", self._inertia(joint), cure)

    def _unit(self, joint: int) -> str:
        """In which a joint's torque (0-based) would be right."""
        kinds, stated = self.by_factor[joint].kinds, self.motion.units.get(f"tau{self.reading.torques[joint] + 1}", "")
        current = "current" in kinds or (bool(stated) and UNITS[normal_unit(stated)][0] == "current")
        if current:
            return "mA" if "milli" in kinds else "A"
        return "mN m" if self.joints[joint].type == "revolute" else "mN"

    def _inertia(self, joint: int) -> str:
        fitted, stated = self.by_factor[joint].fitted, self.by_factor[joint].stated
        comes, file = f"its inertia comes to {number(fitted, 3)}", f"the {number(stated, 3)} in the model file"
        if fitted > stated:
            return f"{comes}, {number(fitted / stated, 4)} times {file}"
        return f"{comes}, 1/{number(stated / fitted, 3)} of {file}"

    def _errors(self, joint: int) -> tuple[str, str]:
        """Relative errors as recorded and put right, in percent."""
        assert self.errors is not None
        before, after = (f"{100 * errors[joint]:.3g}" for errors in self.errors)
        return before, after

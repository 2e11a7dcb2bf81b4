"""Torques that nobody recorded: what the law of a drive makes of its command.

Signals that a law needs and a file lacks follow from others: rates from positions by differences, as a servo takes
them itself, and the integral of its error from the start of each run. A command that acts later is read so much
earlier.

A servo's command steps once a row, and a rate read at the steps is the extreme of what they make of it: more than the
mean over a row's time T by k_p T^2 / (12 I) of it, with inertia I. Hence a servo's rate is scaled to its positions.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.recordings.settings import RATE_SCALE
from symbolic.model_file.arm import DescribedJoint
from symbolic.model_file.drive_laws import COMMANDS, DELAY, INTEGRAL, LAWS, SATURATION, DriveLaw, parted


@dataclass(frozen=True)
class ToldGain:
    """A coefficient of a law, identified.

    interval   of 95 %; None: the data tell no scale, and the value is per unit of the command's coefficient
    imitated   effects of the joint make the same torque, and have its part
    """

    name: str
    value: float
    unit: str
    interval: tuple[float, float] | None
    imitated: bool = False


@dataclass(frozen=True, eq=False)
class DrivenJoint:
    """A joint whose torque a law makes.

    gains      those of the model file
    signals    what the law reads, (N,) each
    uncommanded   the same along the same motion under no command
    told       coefficients of the law that were identified, by their names; None where the data do not tell one
    supply     the column of the supply's voltage, if it is not the usual one
    prismatic  whether it is a prismatic joint      rate_recorded  whether the joint's rate is
    spared     part of the samples, those with the largest commands, that its limit may cut; while no scale tells which
    """

    law: DriveLaw
    gains: Mapping[str, float]
    signals: Mapping[str, Array]
    uncommanded: Mapping[str, Array]
    told: Mapping[str, ToldGain] = field(default_factory=dict)
    supply: str = ""
    prismatic: bool = False
    rate_recorded: bool = False
    spared: float = 0.0

    @property
    def command_gain(self) -> str:
        """Name of the command's coefficient."""
        return self.law.terms[0].name

    @property
    def unknown(self) -> tuple[str, ...]:
        """Names of the law's coefficients that the model file leaves open."""
        return tuple(t.name for t, c in zip(self.law.terms, self._stated, strict=True) if c is None)

    @cached_property
    def columns(self) -> dict[str, Array]:
        """Each coefficient's part of the torque, (N,) per unit of it."""
        made = self.law.columns(self.signals, self.gains, _ramp)
        return {term.name: np.asarray(x, dtype=np.float64) for term, x in zip(self.law.terms, made, strict=True)}

    @cached_property
    def at_once(self) -> dict[str, Array]:
        """The part of each column, (N,), that follows the motion at once: what the drive feeds back of its own angle,
        or what the motion induces. The rest is of the command, which acts as it is held and handed on."""
        made = self.law.columns(self.uncommanded, self.gains, _ramp)
        return {term.name: x + np.zeros_like(self.signals["q"]) for term, x in zip(self.law.terms, made, strict=True)}

    @property
    def torque_at_once(self) -> Array:
        """(N,) the part of the torque of the acting coefficients that follows the motion at once."""
        return self.summed(self.at_once)

    @property
    def known(self) -> Array:
        """(N,) the part of the torque whose coefficients the model file states, without the drive's limit."""
        columns = self.columns.values()
        parts = (c * x for c, x in zip(self._stated, columns, strict=True) if c)
        return np.asarray(sum(parts, start=np.zeros(len(next(iter(columns))))))

    @property
    def acting(self) -> dict[str, float]:
        """The law's coefficients: stated and identified ones. One that is unknown counts for 1 at the command, as if
        the torque were in the command's unit, and for nothing elsewhere."""
        names = [term.name for term in self.law.terms]
        stated = {name: c for name, c in zip(names, self._stated, strict=True) if c is not None}
        return {name: float(name == names[0]) for name in names} | self._identified | stated

    @property
    def torque(self) -> Array:
        """(N,) of the acting coefficients."""
        return np.asarray(self.law.limited(self._asked, self.gains, _ramp))

    @property
    def cut(self) -> NDArray[np.bool_]:
        """(N,) where the drive's limit may cut a torque of unknown gains, which then say nothing of it; as long as that
        has no scale, where the command's part is among the largest."""
        most = self.gains.get(SATURATION) if self.unknown else None
        if most is None:
            return np.zeros(len(self._asked), dtype=bool)
        if not self.without_scale:
            return np.abs(self._asked) >= most
        part = np.abs(self.columns[self.command_gain])
        return np.asarray(part > np.quantile(part, 1 - self.spared))

    @property
    def _asked(self) -> Array:
        """(N,) torque without the drive's limit."""
        return self.summed(self.columns)

    def summed(self, columns: Mapping[str, Array]) -> Array:
        """(N,) of columns (N,), by the acting coefficients."""
        parts = (c * columns[name] for name, c in self.acting.items() if c)
        return sum(parts, start=np.zeros(len(next(iter(columns.values())))))

    def answer(self, q: Array, qd: Array, dt: float) -> dict[str, Array]:
        """(N,) what errors of the angle and of its rate, (N,) at steps of dt, add to each coefficient's part."""
        none = np.zeros_like(q)
        errors = {**dict.fromkeys(self.signals, none), "q": q, "qd": qd, INTEGRAL: -np.cumsum(q) * dt}
        parts = zip(self.law.terms, self.law.columns(errors, self.gains, _ramp), strict=True)
        return {term.name: x + none for term, x in parts}

    def reread(self, error: Array, t: Array, run: NDArray[np.int64]) -> Array:
        """(N,) by how much an error (N,) of recorded positions changes the torque; t, run (N,) as in a Recording."""
        qd = np.zeros_like(error) if self.rate_recorded else rate(error, t, _runs(run))
        return self.summed(self.answer(error, qd, 0.0))

    @property
    def scale(self) -> float:
        """Torque per unit of the command, on the average; 1 where it is unknown."""
        name = self.command_gain
        gain = self._stated[0] if self._stated[0] is not None else self._identified.get(name, 1.0)
        if self.law.closes_on_angle:
            return gain
        command = self.signals[self.law.command]
        power = float(command @ command)
        return gain * float((self.columns[name] - self.at_once[name]) @ command) / power if power else gain

    @property
    def without_scale(self) -> str:
        """The name of the command's coefficient, if it is unknown and the data do not tell it; else ""."""
        name = self.command_gain
        sure = name not in self.unknown or (name in self.told and self.told[name].interval is not None)
        return "" if sure else name

    @property
    def identified(self) -> tuple[str, ...]:
        """Names of unknown coefficients that were identified and that no effect has."""
        return tuple(name for name in self.unknown if name in self.told and not self.told[name].imitated)

    @property
    def to_write(self) -> dict[str, float]:
        """Identified gains for the model file: key -> value."""
        return {name: gain.value for name, gain in self.told.items() if gain.interval is not None or gain.imitated}

    def with_told(self, told: Mapping[str, ToldGain]) -> DrivenJoint:
        """The same with coefficients that were identified."""
        return replace(self, told=dict(told))

    @property
    def _identified(self) -> dict[str, float]:
        return {name: gain.value for name, gain in self.told.items()}

    @property
    def _stated(self) -> tuple[float | None, ...]:
        return self.law.coefficients(self.gains)


def _ramp(x: Array) -> Array:
    return np.maximum(x, 0.0)


def driven_joints(
    joints: Sequence[DescribedJoint], signals: Mapping[str, Array], t: Array, run: NDArray[np.int64]
) -> tuple[DrivenJoint | None, ...]:
    """Of each joint whose torque is not among the signals and whose drive has a law; `columns` has found what it needs.

    t, run   (N,) as in a Recording
    """
    made: list[DrivenJoint | None] = []
    for number, joint in enumerate(joints, 1):
        law = LAWS.get(joint.drive.law or "") if joint.drive is not None else None
        if law is None or f"tau{number}" in signals:
            made.append(None)
        else:
            named = {name: _numbered(name, number) for name in ("q", "qd", *COMMANDS)}
            own = {name: signals[key] for name, key in named.items() if key in signals}
            made.append(driven_joint(joint, law, own, t, run))
    return tuple(made)


def driven_joint(
    joint: DescribedJoint, law: DriveLaw, own: Mapping[str, Array], t: Array, run: NDArray[np.int64]
) -> DrivenJoint:
    """A joint whose drive has a law, with its own signals (N,)."""
    gains = joint.drive.gains if joint.drive is not None else {}
    supply = next((law.source(s, own, gains) or "" for s in law.instead if s not in own), "")
    none = dict.fromkeys({law.command, "qd_desired"} & own.keys(), np.zeros(len(t)))
    if law.closes_on_angle and "qd" in own:
        own = _scaled_rate(own, rate(own["q"], t, _runs(run)))
    return DrivenJoint(
        law,
        gains,
        _complete(law, gains, own, t, run),
        _complete(law, gains, {**own, **none}, t, run),
        supply=supply if supply in own else "",
        prismatic=joint.type == "prismatic",
        rate_recorded="qd" in own,
    )


def _scaled_rate(own: Mapping[str, Array], of_positions: Array) -> dict[str, Array]:
    """A joint's signals (N,) with the measured rate times what makes it that of positions (N,); without it where it has
    another unit."""
    measured, others = own["qd"], {name: signal for name, signal in own.items() if name != "qd"}
    power = float(measured @ measured)
    scale = float(measured @ of_positions) / power if power else 0.0
    return {**others, "qd": scale * measured} if 1 / RATE_SCALE < scale < RATE_SCALE else others


def driven_notes(driven: Sequence[DrivenJoint | None]) -> list[str]:
    """What users should know about how torques were made."""
    alike: dict[str, list[str]] = {}
    for number, joint in enumerate(driven, 1):
        if joint is not None:
            supply = f"; the column {joint.supply} is taken for the supply's voltage" * bool(joint.supply)
            unknown = f"; {' and '.join(joint.unknown)} unknown" * bool(joint.unknown)
            said = f"by the drive's law {joint.law.name}: {joint.law.equation}{supply}{unknown}"
            alike.setdefault(said, []).append(f"tau{number}")
    return [f"made {said}: {', '.join(torques)}" for said, torques in alike.items()]


def told_notes(driven: Sequence[DrivenJoint | None]) -> list[str]:
    """What was identified of the drives, in words."""
    notes = []
    for number, joint in enumerate(driven, 1):
        if joint is None or not joint.told:
            continue
        for gain in joint.told.values():
            if gain.imitated:
                notes.append(
                    f"joint {number}: {gain.name} makes the torque of an effect of the joint, and counts for it"
                )
        gains = [gain for gain in joint.told.values() if not gain.imitated]
        if not gains:
            continue
        first = gains[0]
        scaled = first.interval is not None
        listed = ", ".join(_said(gain) for gain in gains[not scaled :])
        if scaled:
            notes.append(f"joint {number}: identified {listed}")
            continue
        ratios = f": {listed}" * bool(listed)
        notes.append(
            f"joint {number}: nothing known gives the scale of {first.name}; ratios alone are told{ratios}. Torques "
            f"and parameters are those for {first.name} = 1 {first.unit}. State {first.name} in the model file, or the "
            "inertia or the weight that the joint moves"
        )
    return notes


def _said(gain: ToldGain) -> str:
    ends = f" ({gain.interval[0]:.4g} to {gain.interval[1]:.4g})" if gain.interval else ""
    return f"{gain.name} = {gain.value:.4g} {gain.unit}{ends}"


def _numbered(signal: str, number: int) -> str:
    stem, ending = parted(signal)
    return f"{stem}{number}{ending}"


def _complete(
    law: DriveLaw, gains: Mapping[str, float], own: Mapping[str, Array], t: Array, run: NDArray[np.int64]
) -> dict[str, Array]:
    """Signals of a law: those of a file, and what follows from them."""
    found, runs = dict(own), _runs(run)
    for signal, (column, gain) in law.instead.items():
        if signal not in found:
            found[signal] = found[column] if column in found else np.full(len(t), gains[gain])
    if "qd" not in found:
        found["qd"] = rate(found["q"], t, runs)
    if law.closes_on_angle and "qd_desired" not in found:
        found["qd_desired"] = rate(found["q_desired"], t, runs)
    if late := gains.get(DELAY, 0.0):
        for name in {law.command, "qd_desired"} & found.keys():
            found[name] = np.concatenate([np.interp(t[r] - late, t[r], found[name][r]) for r in runs])
    if law.closes_on_angle:
        error = found["q_desired"] - found["q"]
        step = np.concatenate([np.append(0.0, np.diff(t[r])) for r in runs])
        found[INTEGRAL] = np.concatenate([np.cumsum((error * step)[r]) for r in runs])
    return found


def _runs(run: NDArray[np.int64]) -> list[slice]:
    starts = np.flatnonzero(np.diff(run, prepend=run[0] - 1))
    return [slice(int(a), int(b)) for a, b in zip(starts, [*starts[1:], len(run)], strict=True)]


def rate(x: Array, t: Array, runs: Sequence[slice]) -> Array:
    """(N,) rate of x (N,) within each run: that of a cubic spline, since a servo takes differences over steps that are
    far shorter than a logger's, and a difference of samples is too small by (frequency / rate of samples)^2 times 6.6.
    """
    from scipy.interpolate import CubicSpline  # where it is used: it takes longer to load than a fit

    return np.concatenate([CubicSpline(t[r], x[r])(t[r], 1) if r.stop - r.start > 1 else np.zeros(1) for r in runs])

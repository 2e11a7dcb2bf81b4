"""How a drive makes its torque from what it is commanded: one declaration a law, from which all else follows.

A law is a sum of coefficients times columns. Its columns are arithmetic on signals, so that the same declaration gives
arrays along a recording, expressions in SymPy and the C of the firmware; `ramp` is the only switch, as in an effect.
The coefficients are gains of the model file or follow from them; one whose gains the file leaves out is unknown.

Torques are those at the joint's output. Source: for motors, Krause, Wasynczuk & Sudhoff, Analysis of Electric
Machinery and Drive Systems, 2013; for dead time, Jeong & Park, IEEE Trans. Industrial Electronics 38(2), 1991; for
unknown drive gains, Gautier & Briot, ASME J. Dynamic Systems, Measurement, and Control 136(5), 2014.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any, Final

from symbolic.model_file.fields import Choice, Number

Signals = Mapping[str, Any]
"""Signals of a joint by name: arrays (N,) or expressions."""
Gains = Mapping[str, float]
Ramp = Callable[[Any], Any]
"""x for x > 0, else 0."""


@dataclass(frozen=True)
class CommandSignal:
    """A column of a recording that a law reads, beside q and qd.

    kind    "position" or "rate" of the joint, or a dimension of its own
    """

    name: str
    kind: str
    meaning: str


COMMANDS: Final = {
    signal.name: signal
    for signal in (
        CommandSignal("q_desired", "position", "demanded position"),
        CommandSignal("qd_desired", "rate", "demanded rate"),
        CommandSignal("duty", "ratio", "part of the supply that the bridge puts on the motor, -1 to 1"),
        CommandSignal("voltage", "voltage", "on the motor, with its sign"),
        CommandSignal("bus_voltage", "voltage", "of the supply"),
        CommandSignal("current", "current", "of the motor, with its sign"),
    )
}
"""Signals of a recording from which a law makes torque."""


def parted(signal: str) -> tuple[str, str]:
    """A joint's signal as what stands before and behind the joint's number: qd_desired as qd, _desired."""
    stem, desired, _ = signal.partition("_desired")
    return stem, desired


INTEGRAL: Final = "error_integral"
"""A servo's signal: q_desired - q, integrated over time since the run began, rad s (m s)."""


@dataclass(frozen=True)
class LawTerm:
    """A part of a law: coefficient times column.

    coefficient   of the gains; None: one that it needs is unknown
    column        of signals and of the gains that shape it
    unit          of the coefficient
    """

    name: str
    unit: tuple[str, str]
    coefficient: Callable[[Gains], float | None]
    column: Callable[[Signals, Gains, Ramp], Any]


@dataclass(frozen=True)
class DriveLaw:
    """A way in which a drive makes torque.

    command    the signal by which it is commanded     unit   of that signal at a revolute and a prismatic joint
    reads      columns that a recording must have      also   columns that it may have
    gains      keys of [joint.drive]                   terms  the first is that of the command
    inverse    the command at which the first column has a value, of that value and the other signals
    instead    column -> what may stand in its place: another column, then a gain
    """

    name: str
    summary: str
    equation: str
    command: str
    unit: tuple[str, str]
    reads: tuple[str, ...]
    also: tuple[str, ...]
    gains: tuple[Number, ...]
    terms: tuple[LawTerm, ...]
    inverse: Callable[[Any, Signals, Gains], Any]
    instead: Mapping[str, tuple[str, str]]

    @property
    def closes_on_angle(self) -> bool:
        """Whether it is a servo, whose torque follows the error of the joint's position."""
        return COMMANDS[self.command].kind == "position"

    def source(self, signal: str, there: Collection[str], gains: Gains) -> str | None:
        """The column, among those that are there, or the gain that is a signal of this law; None: neither."""
        column, gain = self.instead.get(signal, (signal, ""))
        return next((name for name in (signal, column) if name in there), gain if gain in gains else None)

    def coefficients(self, gains: Gains) -> tuple[float | None, ...]:
        """Of all terms; None where unknown."""
        return tuple(term.coefficient(gains) for term in self.terms)

    def columns(self, signals: Signals, gains: Gains, ramp: Ramp) -> tuple[Any, ...]:
        """Of all terms."""
        return tuple(term.column(signals, gains, ramp) for term in self.terms)

    def torque(self, signals: Signals, gains: Gains, ramp: Ramp) -> Any:
        """The torque; all coefficients must be known."""
        pairs = zip(self.coefficients(gains), self.columns(signals, gains, ramp), strict=True)
        return self.limited(sum(c * x for c, x in pairs if c), gains, ramp)

    def limited(self, torque: Any, gains: Gains, ramp: Ramp) -> Any:
        """The torque within the drive's limit, if the gains state one."""
        if (most := gains.get(SATURATION)) is None:
            return torque
        return torque - ramp(torque - most) + ramp(-torque - most)


SATURATION: Final = "saturation"
DELAY: Final = "delay"
_OUTPUT = "at the joint's output: the motor's times gear_ratio"
_SHARED = (
    Number(
        SATURATION,
        "largest torque that the drive makes, if it limits it",
        unit=("N m", "N"),
        positive=True,
        default=None,
    ),
    Number(DELAY, "time after which a command acts", unit="s", low=0.0, default=None),
)
_MOTOR_CONSTANT = Number(
    "torque_constant",
    f"torque per current {_OUTPUT}; left out: that of the joint",
    unit=("N m/A", "N/A"),
    positive=True,
    default=None,
)
_WINDING = (
    _MOTOR_CONSTANT,
    Number("resistance", "of the winding", unit="ohm", positive=True, default=None),
    Number(
        "torque_per_volt",
        "torque at standstill per voltage, in place of torque_constant and resistance",
        unit=("N m/V", "N/V"),
        positive=True,
        default=None,
    ),
    Number(
        "back_emf",
        f"voltage per rate {_OUTPUT}; left out: torque_constant, which is the same in SI, and if that is unknown "
        "a part of viscous friction",
        unit=("V s/rad", "V s/m"),
        low=0.0,
        default=None,
    ),
)


def _gain(key: str, absent: float | None = None) -> Callable[[Gains], float | None]:
    return lambda gains: gains.get(key, absent)


def _per_volt(gains: Gains) -> float | None:
    if (stated := gains.get("torque_per_volt")) is not None:
        return stated
    constant, resistance = gains.get("torque_constant"), gains.get("resistance")
    return None if constant is None or resistance is None else constant / resistance


def _back_emf(signals: Signals, gains: Gains) -> Any:
    constant = gains.get("back_emf", gains.get("torque_constant"))
    return constant * signals["qd"] if constant else 0


def _bridge(signals: Signals, gains: Gains, ramp: Ramp) -> Any:
    duty, lost = signals["duty"], gains.get("dead_duty", 0.0)
    acting = ramp(duty - lost) - ramp(-duty - lost) if lost else duty
    return acting * signals["bus_voltage"]


def _duty(volts: Any, signals: Signals, gains: Gains) -> Any:
    acting = (volts + _back_emf(signals, gains)) / signals["bus_voltage"]
    # The sign as a quotient, which arrays and expressions share.
    return acting + gains.get("dead_duty", 0.0) * acting / (abs(acting) + (acting == 0))


def _winding(volts: Callable[[Signals, Gains, Ramp], Any]) -> tuple[LawTerm, ...]:
    return (
        LawTerm("torque_per_volt", ("N m/V", "N/V"), _per_volt, lambda s, g, ramp: volts(s, g, ramp) - _back_emf(s, g)),
    )


_LISTED = (
    DriveLaw(
        name="current",
        summary="A drive that measures or controls its motor's current.",
        equation="k_t i",
        command="current",
        unit=("A", "A"),
        reads=("current",),
        also=(),
        gains=(_MOTOR_CONSTANT, *_SHARED),
        terms=(LawTerm("torque_constant", ("N m/A", "N/A"), _gain("torque_constant"), lambda s, *_: s["current"]),),
        inverse=lambda value, *_: value,
        instead={},
    ),
    DriveLaw(
        name="voltage",
        summary="A motor on a known voltage.",
        equation="k_t / R (V - k_e qd)",
        command="voltage",
        unit=("V", "V"),
        reads=("voltage",),
        also=(),
        gains=(*_WINDING, *_SHARED),
        terms=_winding(lambda s, *_: s["voltage"]),
        inverse=lambda value, s, g: value + _back_emf(s, g),
        instead={},
    ),
    DriveLaw(
        name="pwm",
        summary="A motor on a bridge that switches the supply's voltage on for a part of each period.",
        equation="k_t / R (d V_bus - k_e qd), d the duty beyond that which the dead time takes",
        command="duty",
        unit=("of full duty", "of full duty"),
        reads=("duty", "bus_voltage"),
        also=(),
        gains=(
            *_WINDING,
            Number(
                "bus_voltage",
                "of the supply, where the recording has no column of it",
                unit="V",
                positive=True,
                default=None,
            ),
            Number(
                "dead_duty",
                "duty below which the motor gets no voltage: dead time times switching frequency",
                low=0.0,
                high=1.0,
                default=None,
            ),
            *_SHARED,
        ),
        terms=_winding(_bridge),
        inverse=_duty,
        instead={"bus_voltage": ("voltage", "bus_voltage")},
    ),
    DriveLaw(
        name="position_servo",
        summary="A drive that is told a position and makes torque from the error.",
        equation="k_p (q_desired - q) + k_d (qd_desired - qd) + k_i times the integral of q_desired - q",
        command="q_desired",
        unit=("rad", "m"),
        reads=("q_desired",),
        also=("qd_desired",),
        gains=(
            Number("kp", "torque per error of position", unit=("N m/rad", "N/m"), positive=True, default=None),
            Number("kd", "torque per error of rate", unit=("N m s/rad", "N s/m"), low=0.0, default=None),
            Number("ki", "torque per integral of the error", unit=("N m/(rad s)", "N/(m s)"), low=0.0, default=None),
            *_SHARED,
        ),
        terms=(
            LawTerm("kp", ("N m/rad", "N/m"), _gain("kp"), lambda s, *_: s["q_desired"] - s["q"]),
            LawTerm("kd", ("N m s/rad", "N s/m"), _gain("kd"), lambda s, *_: s["qd_desired"] - s["qd"]),
            LawTerm("ki", ("N m/(rad s)", "N/(m s)"), _gain("ki", 0.0), lambda s, *_: s[INTEGRAL]),
        ),
        inverse=lambda value, s, _: s["q"] + value,
        instead={},
    ),
)
LAWS: Final = {law.name: law for law in _LISTED}
"""Every law by name."""


def _keys() -> tuple[Number, ...]:
    found: dict[str, Number] = {}
    for law in _LISTED:
        for gain in law.gains:
            found.setdefault(gain.key, gain)
    return tuple(found.values())


LAW = Choice(
    "law",
    "how torque is made where none is recorded, with its gains; gains left out are unknown",
    tuple(LAWS),
    " or ".join(f'"{name}"' for name in LAWS),
    default=None,
)
GAIN_KEYS: Final = _keys()
"""The keys of all laws, each once."""

"""The gates that a candidate must pass before it is named: a number of each against a limit.

The first of them is the score (score.py); the others ask what no likelihood answers: is it large enough, is it what its
declaration says, do further sensors and further recordings agree. English is no part of a decision: sentences about
results are made for people elsewhere.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final, Literal

from runtime.diagnosis.settings import LEAST_PRICE
from runtime.motion.settings import MOST, RESOLVED, SOME
from runtime.regression.settings import LEAST_OWN

Sensor = Literal["link encoder", "output sensor"]
_TRIAL: Final = "trial of the method: 15 effects in a joint, 45 recordings with and 44 without a hidden effect"
_CODED: Final = "development recordings with coarse encoders"
_LINKED: Final = "development recordings with link-side encoders"


@dataclass(frozen=True)
class Gate:
    """One gate. It opens where the statistic, with the margin for its spread, is on the right side of the limit.

    sensor       the further sensor that is asked, None: the motor torque
    """

    name: str
    statistic: str
    opens: Literal["above", "below"]
    limit: float
    unit: str
    reason: str
    source: str
    sensor: Sensor | None = None

    def asked(self, value: float, limit: float | None = None, spread: float = 0.0) -> GateResult:
        """The result for a statistic; limit: where it depends on the candidate; spread: of the statistic."""
        return GateResult(self, value, self.limit if limit is None else limit, spread)


@dataclass(frozen=True)
class GateResult:
    """A candidate at a gate: the statistic, its limit, and the spread that counts in the candidate's favour."""

    gate: Gate
    value: float
    limit: float
    spread: float = 0.0

    @property
    def passes(self) -> bool:
        if self.gate.opens == "above":
            return self.value + self.spread > self.limit
        return self.value - self.spread < self.limit


SCORE: Final = Gate(
    "score",
    "gain of the log-likelihood over its dispersion",
    "above",
    LEAST_PRICE,
    "natural logarithm",
    "the price of having looked at so many joints, shapes and unknowns; dearer for a larger search",
    "score.py; clean recordings of four joints reach 9",
)
TORQUE: Final = Gate(
    "torque",
    "RMS of the torque that only this candidate explains",
    "above",
    0.15,
    "noise floors",
    "less drowns in the noise",
    _TRIAL,
)
PART: Final = Gate(
    "part",
    "RMS of that torque, of the joint's whole torque",
    "above",
    RESOLVED,
    "part",
    "an error that is less is not asked for anything",
    "magnets weaken by so much a kelvin, and a motor's torque with them",
)
EDGE: Final = Gate(
    "edge",
    "distance of the shape from the nearer end of what was searched",
    "above",
    0.02,
    "part of the stretch",
    "a shape nearer to an end was not found but stopped there",
    "development recordings",
)
ONCE: Final = Gate(
    "once",
    "number of even stretches of time, of 40, over which its torque is spread; not asked where recordings that were "
    "not fitted bear it out, or no other law has half its gain",
    "above",
    2.0,
    "stretches",
    "what happened once may be any of several laws",
    "a choice: twice, or for a twentieth of the time",
)
FALL: Final = Gate(
    "fall",
    "fall of the error, RMS, at one of the effect's joints, all refitted with it",
    "above",
    0.01,
    "part",
    "no user would add an effect for a smaller improvement",
    _TRIAL,
)
SIZE: Final = Gate(
    "size",
    "whether the refitted size lies at its bound, or only in sums with inertial parameters",
    "below",
    1.0,
    "1 if so",
    "a value at its bound was not found but stopped there",
    "by construction",
)
CONTACT: Final = Gate(
    "contact",
    "part of a contact's push that the torque shows, in that direction of motion in which it is less",
    "above",
    0.75,
    "part",
    "a contact pushes back whichever way the joint moves; drag over a part of the range and what follows a reversal do "
    "not",
    "development recordings of stops: 0.94 and more, 0.57 at most of what follows a reversal",
)
TURN: Final = Gate(
    "turn",
    "distance of the interval of a line's order from the nearest whole one",
    "below",
    0.005,
    "part of the distance of whole orders",
    "any other line is one over time, a law over the position, or chance, which comes so near once in a hundred times",
    "by construction",
)
REST: Final = Gate(
    "rest",
    "part of what it and a law over the same signals at its joint explain together that is lost without it",
    "above",
    0.03,
    "part",
    "a law that comes within a sixth of an effect's amplitude is that effect in another form",
    "development recordings with forms that are not the library's, and with two effects",
)
HELD_OUT: Final = Gate(
    "held out",
    "squared error that it leaves on recordings that were not fitted, of that without it",
    "below",
    0.93,
    "part",
    "chance does not reach it",
    "development recordings, and real ones, on which 0.95 was reached by effects that are not there",
)
RESOLUTION: Final = Gate(
    "resolution",
    "width of a gap over the standard deviation of the encoder's noise",
    "above",
    7.0,
    "standard deviations",
    "a narrower gap is crossed where the noise says: two steps of the encoder, rounded evenly, either flank a step off",
    "by construction",
)
MODEL: Final = Gate(
    "model",
    "square of the torque that the model cannot take over, of the whole",
    "above",
    LEAST_OWN,
    "part",
    "a hundredth of its size must be the candidate's own",
    "development recordings",
)
ENCODERS: Final = Gate(
    "encoders",
    "square of what another reading of the encoders would change, of the torque's own square",
    "below",
    MOST,
    "part",
    "beyond, it is the encoder's torque and not the candidate's",
    _CODED,
)
LAG: Final = Gate(
    "lag",
    "part of a transmission's torque by which the link lags behind",
    "above",
    SOME,
    "part",
    "inertia that is not well known scales the lag",
    _LINKED,
    sensor="link encoder",
)
RIGID: Final = Gate(
    "rigid",
    "part of another candidate's torque that is the lag of the link",
    "below",
    MOST,
    "part",
    "then the transmission gives way instead; between all of it and none, by construction",
    _LINKED,
    sensor="link encoder",
)
MORE_PLAY: Final = Gate(
    "more play",
    "play that the link-side encoder shows beyond the candidate's",
    "below",
    0.2,
    "part of the twist's standard deviation",
    "a smaller error of a gap is a matter of its value and not of its being there",
    _LINKED,
    sensor="link encoder",
)
LESS_PLAY: Final = Gate(
    "less play",
    "play that the candidate has beyond what the link-side encoder shows",
    "below",
    MORE_PLAY.limit,
    MORE_PLAY.unit,
    MORE_PLAY.reason,
    _LINKED,
    sensor="link encoder",
)
ON_LINK: Final = Gate(
    "on the link",
    "part of a torque on the link that the torque sensor at the output feels",
    "above",
    MOST,
    "part",
    "between all of it and none",
    "by construction",
    sensor="output sensor",
)
ON_MOTOR: Final = Gate(
    "on the motor",
    "part of a torque on the motor that the torque sensor at the output feels",
    "below",
    ON_LINK.limit,
    "part",
    ON_LINK.reason,
    ON_LINK.source,
    sensor="output sensor",
)
BOUND: Final = Gate(
    "bound",
    "lower end of the interval of what the encoders show",
    "above",
    0.0,
    "unit of the parameter",
    "an interval that holds none does not show the effect",
    "by construction",
)
BOTH_JOINTS: Final = Gate(
    "both joints",
    "gain of the log-likelihood by a torque of two joints over its part at one of them, the lesser",
    "above",
    LEAST_PRICE,
    SCORE.unit,
    "a torque on the rate of two joints shows at either, beside what explains most there alone; one law at one joint, "
    "seen over two rates that are alike, does not",
    "development recordings with two joints: 150 and more where a motor turns with both",
)
RECORDINGS: Final = Gate(
    "recordings",
    "number of parameters on which the recordings contradict each other",
    "below",
    1.0,
    "number",
    "where recordings contradict each other, no single model fits all, and an effect may be missing in some only",
    "by construction",
)

GATES: Final = (
    *(SCORE, TORQUE, PART, EDGE, RESOLUTION, MODEL, ENCODERS),
    *(ONCE, FALL, SIZE, CONTACT, TURN, REST, HELD_OUT),
    *(LAG, RIGID, MORE_PLAY, LESS_PLAY, ON_LINK, ON_MOTOR, BOUND),
    *(BOTH_JOINTS, RECORDINGS),
)
"""In the order in which their failures are listed."""


def failed(results: Iterable[GateResult]) -> tuple[GateResult, ...]:
    """Of some results, those of gates that stay closed."""
    return tuple(result for result in results if not result.passes)

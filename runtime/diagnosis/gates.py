"""The gates that a candidate must pass before it is named: a number of each against a limit.

On clean recordings a difference in BIC alone names an effect more often than not; every gate must open. English is no
part of a decision: sentences about results are made for people elsewhere.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final, Literal

from runtime.identification.settings import CLEARLY_LIKELIER
from runtime.regression.settings import LEAST_OWN

Sensor = Literal["link encoder", "output sensor"]
_TRIAL: Final = "trial of the method: 15 effects in a joint, 45 recordings with and 44 without a hidden effect"
_CODED: Final = "development recordings with coarse encoders"
_LINKED: Final = "development recordings with link-side encoders"


@dataclass(frozen=True)
class Gate:
    """One gate. It opens where the statistic, with the margin for its spread, is on the right side of the limit.

    answerable   whether a recording that was not fitted answers it better
    sensor       the further sensor that is asked, None: the motor torque
    """

    name: str
    statistic: str
    opens: Literal["above", "below"]
    limit: float
    unit: str
    reason: str
    source: str
    answerable: bool = False
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


BIC: Final = Gate(
    "bic",
    "fall of BIC on whitened rows, the search for shapes and lines charged",
    "above",
    CLEARLY_LIKELIER,
    "natural logarithm, doubled",
    "on clean recordings 10 alone would have named something on 23 of 30",
    _TRIAL,
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
SHARE: Final = Gate(
    "share",
    "square of that torque, of the variance above the noise floor",
    "above",
    0.2,
    "part",
    "a candidate that explains less is not what is missing; half is enough where a joint may have several, and where "
    "recordings that were not fitted decide",
    "a quarter in the trial of the method, a fifth after development recordings with two effects",
    answerable=True,
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
LIKELIHOOD: Final = Gate(
    "likelihood",
    "gain of the cross-validated log-likelihood on whitened rows",
    "above",
    CLEARLY_LIKELIER / 2,
    "natural logarithm",
    "half of what BIC must fall by",
    _TRIAL,
    answerable=True,
)
ERROR: Final = Gate(
    "error",
    "fall of the cross-validated error, RMS",
    "above",
    0.01,
    "part",
    "no user would add an effect for a smaller improvement",
    _TRIAL,
    answerable=True,
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
    0.4,
    "part",
    "beyond, it is the encoder's torque and not the candidate's",
    _CODED,
)
LAG: Final = Gate(
    "lag",
    "part of a transmission's torque by which the link lags behind",
    "above",
    0.3,
    "part",
    "inertia that is not well known scales the lag",
    _LINKED,
    sensor="link encoder",
)
RIGID: Final = Gate(
    "rigid",
    "part of another candidate's torque that is the lag of the link",
    "below",
    0.5,
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
    0.5,
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
    "fall of BIC on whitened rows by a torque of two joints over its part at one of them, the lesser",
    "above",
    BIC.limit,
    BIC.unit,
    "a torque on the rate of two joints shows at either, beside what explains most there alone; one law at one joint, "
    "seen over two rates that are alike, does not: of a viscous torque from the other joint's rate it rises by 500",
    "development recordings with two joints: 300 and more where a motor turns with both",
)
EACH_SHARE: Final = Gate(
    "share at each joint",
    "part of the variance above the noise floor that a torque of two joints explains, at the joint with the lesser",
    "above",
    SHARE.limit,
    SHARE.unit,
    "what is missing at two joints because a motor turns with both is so at either",
    "simulated drag of a fluid, which acts on both joints: 0.1 and 0.6",
)
PROPORTION: Final = Gate(
    "proportion",
    "part of what separate torques at two joints explain that is lost where one motor makes both, whitened",
    "below",
    0.2,
    "part",
    "a motor works on both joints in proportion: 0.02 at most is lost then, half and more of a torque that acts on one",
    "development recordings with two joints",
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
    *(BIC, TORQUE, SHARE, EDGE, LIKELIHOOD, ERROR, RESOLUTION, MODEL, ENCODERS),
    *(LAG, RIGID, MORE_PLAY, LESS_PLAY, ON_LINK, ON_MOTOR, BOUND),
    *(EACH_SHARE, BOTH_JOINTS, PROPORTION, RECORDINGS),
)
"""In the order in which their failures are listed."""


def failed(results: Iterable[GateResult]) -> tuple[GateResult, ...]:
    """Of some results, those of gates that stay closed."""
    return tuple(result for result in results if not result.passes)

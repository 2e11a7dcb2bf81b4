"""Figures of the paper. Torques in N m, costs in N²m²s, stiffnesses in N/m, times in s, speeds in rad/s."""

from __future__ import annotations

from dataclasses import dataclass

TRIALS = 3
"""Trials of each case in the experiment."""
CYCLES_1 = (1.2, 2.0)
"""Cycle times of Table II."""
CYCLES_2 = (1.2, 1.6, 2.0)
"""Cycle times of Table III."""
PLATES = (600.0, 1300.0)
"""Stiffnesses of the plate in Table III; the text has 686 N/m."""


@dataclass(frozen=True)
class Friction:
    """A row of Table I: the largest speeds of the cosines, and the parameters of (4)."""

    speeds: tuple[float, ...]
    positive: float
    negative: float
    viscous: float
    cubic: float


PRECISION = 0.005
"""Half a unit of the last digit that Table I prints."""
TABLE_1 = (
    Friction((1.0, 2.0), 1.46, 0.83, viscous=2.53, cubic=-0.21),
    Friction((1.0, 2.0), 1.14, 0.91, viscous=2.18, cubic=-0.19),
    Friction((1.0, 2.5), 1.01, 1.14, viscous=1.93, cubic=-0.12),
    Friction((1.0, 3.0, 5.0), 1.72, 1.05, viscous=1.14, cubic=-0.01),
)


@dataclass(frozen=True)
class Cost:
    """A case at one cycle time (and plate): simulation, experiment (mean of three trials), the spring's stiffness."""

    simulation: float
    experiment: float
    stiffness: float | None = None


TABLE_2 = {
    (1.2, "A"): Cost(15.4, 31.5),
    (1.2, "B"): Cost(5.2, 22.2, 7900.0),
    (1.2, "C"): Cost(35.8, 36.4),
    (1.2, "D"): Cost(23.8, 25.9, 7900.0),
    (2.0, "A"): Cost(3.3, 23.0),
    (2.0, "B"): Cost(1.2, 20.2, 5900.0),
    (2.0, "C"): Cost(23.7, 22.6),
    (2.0, "D"): Cost(20.5, 20.8, 5100.0),
}
"""By cycle time and case of scenario 1."""

TABLE_3 = {
    (1.2, 600.0, "C"): Cost(149.1, 179.4),
    (1.2, 600.0, "D"): Cost(137.0, 167.5, 5100.0),
    (1.2, 1300.0, "C"): Cost(142.7, 162.3),
    (1.2, 1300.0, "D"): Cost(125.4, 148.4, 5900.0),
    (1.6, 600.0, "C"): Cost(107.3, 130.3),
    (1.6, 600.0, "D"): Cost(93.8, 111.3, 5900.0),
    (1.6, 1300.0, "C"): Cost(119.1, 139.6),
    (1.6, 1300.0, "D"): Cost(84.0, 94.5, 7100.0),
    (2.0, 600.0, "C"): Cost(93.8, 111.9),
    (2.0, 600.0, "D"): Cost(85.0, 100.4, 5900.0),
    (2.0, 1300.0, "C"): Cost(136.6, 146.0),
    (2.0, 1300.0, "D"): Cost(85.9, 104.2, 7900.0),
}
"""By cycle time, plate and case of scenario 2."""

REVERSAL = {"B": -1.48, "D": -1.54}
"""rad: where joint 4 turned in the experiment, scenario 1 at 1.2 s (Fig. 6); planned: -pi/2."""
COMPRESSION = {None: 0.050, 600.0: 0.045, 1300.0: 0.041}
"""m: planned, and reached in case 2D at 1.6 s by plate."""
JOINT_4 = {600.0: 25.6, 1300.0: 50.2}
"""Joint 4's part of the cost of case 2C at 1.6 s, by plate (section V.B)."""
JOINT_4_LEFT = (13.0, 16.0)
"""The same in case 2D, at any cycle time."""

"""Every number by which bodies are found for given base parameters: its unit, its reason, its source."""

from __future__ import annotations

from typing import Final

MAP_STATES: Final = 60
"""number of states; by which the map from all inertial parameters to the base ones is found: five times as many
equations as columns of a seven-joint arm; by construction."""

MAP_RATE: Final = 2.0
"""rad/s, m/s; and their derivatives; rates of those states, so that gravity, inertia and centrifugal torques are of one
size as in the motions of real arms; decides no verdict; a choice."""

BODY_LENGTH: Final = 0.1
"""m; by which a shift of a centre counts as much as a change of e times of a mass; the size of links; a
choice."""

LEAST_GYRATION: Final = 1e-3
"""m; radius of gyration below which a body of a file is a point or a sheet, which a simulator refuses; a millimetre is
thinner than any link; a choice."""

LEAST_MASS: Final = 1e-6
"""kg; of a body of a file that has none: simulators refuse such, and no torque shows a milligram; a choice."""

NEAR_REFERENCE: Final = (1e-3, 1e-5, 1e-7)
"""ratios; of a distance from the reference to a part of the torque, one search after another: the first goes the
shortest way to within a thousandth of the torques, and the next ones follow it down where the way bends; a choice."""

SEARCH_STEPS: Final = 60
"""number of evaluations; of the search; a seven-joint arm of possible bodies takes ten, and one of impossible ones
is near the end of what can be won after sixty; arms of random bodies."""

EXACT_STEPS: Final = 40
"""number of steps; from there to the base parameters themselves; three do where possible bodies have them, and more
only where a step is cut short; arms of random bodies."""

LEAST_GAIN: Final = 0.9
"""ratio; of the missing torque after such a step to the one before, above which there is nothing to be won; Newton's
steps square it; a choice."""

EXACT_TORQUE: Final = 1e-13
"""part of the torque; what rounding leaves of it; double precision; by construction."""

LARGEST_TURN: Final = 0.5
"""unit; of a logarithm in one step, over which the exponential is still nearly a line; a choice."""

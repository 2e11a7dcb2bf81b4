"""Numbers of the search for physically possible bodies, each with unit, reason and source."""

from __future__ import annotations

from typing import Final

MAP_STATES: Final = 60
"""number of states; for the map from full to base parameters: five times as many
equations as columns of a seven-joint arm; by construction."""

MAP_RATE: Final = 2.0
"""rad/s, m/s; rates of those states, and with 1/s their accelerations, so that gravity, inertial and centrifugal
torques have similar sizes, as in motions of real arms; decides no verdict; a choice."""

BODY_LENGTH: Final = 0.1
"""m; a shift of a centre of mass by so much counts as much as a factor e of a mass; the size of links; a choice."""

LEAST_GYRATION: Final = 1e-3
"""m; least radius of gyration: simulators refuse points and sheets; a millimetre is thinner than any link; a choice."""

LEAST_MASS: Final = 1e-6
"""kg; least mass: simulators refuse bodies without mass; no torque shows a milligram; a choice."""

NEAR_REFERENCE: Final = (1e-3, 1e-5, 1e-7)
"""ratios; weights of the distance from the reference against the torque error, one search after another: the first
goes the shortest way to within a thousandth of the torque, the next ones follow a curved way further; a choice."""

SEARCH_STEPS: Final = 60
"""number of evaluations; possible bodies of a seven-joint arm take ten, and impossible ones hardly improve after sixty;
arms of random bodies."""

EXACT_STEPS: Final = 40
"""number of steps; from there to the exact base parameters; three suffice if possible bodies have them, and shortened
steps need more; arms of random bodies."""

LEAST_GAIN: Final = 0.9
"""ratio; of the torque errors after and before such a step above which the search ends; Newton's method converges
quadratically; a choice."""

EXACT_TORQUE: Final = 1e-13
"""part of the torque; rounding error; double precision; by construction."""

LARGEST_TURN: Final = 0.5
"""unit; largest change of a logarithm in one step, over which the exponential is nearly linear; a choice."""

PLAY_STEP: Final = 1e-4
"""s; step of MuJoCo's integration of an exported arm: a fifth of it changes 0.3 s of motion by less than 2e-3 of the
motion for every effect, far less than a model misses; MuJoCo 4.0, implicitfast."""

HOLD: Final = 2.5e-4
"""s; for so long at most a torque that is linear between samples is held: at 20 Hz the motion differs by 1e-5; by
construction."""

AT_REST: Final = 1e-3
"""rad/s, m/s; slower joints' bristles begin unbent: which way they came is not known; a choice."""

ROUNDS: Final = 3
"""number of rounds in which the load of elastic joints settles with what it does to friction at rest; a choice."""

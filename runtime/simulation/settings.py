"""Defaults and accuracy of simulated recordings, each with unit, reason and source; "a choice" is arbitrary.

The excitation's motions are in simulate.py.
"""

from __future__ import annotations

from math import pi
from typing import Final

# recordings of a model itself ---------------------------------------------------------------------------------------

RATE: Final = 1000.0
"""Hz; sampling rate, as controllers of geared arms log; a choice."""

COUNT: Final = {"revolute": 2 * pi / 200_000, "prismatic": 1e-6}
"""rad, m; step of the encoder, at the joint's output: 2,000 counts a turn of a motor behind a gear of 100; a choice."""

NOISE: Final = 0.03
"""part of each joint's torque, RMS; standard deviation of the recorded torque's noise; a choice."""

LONGEST: Final = 3600.0
"""s; an hour; a longer motion has its time in milliseconds, most likely; a choice."""

PATH_DEGREE: Final = 5
"""power of the polynomials of the spline through a motion; its acceleration is smooth; standard practice."""

SHARE: Final = 0.2
"""part of each joint's torque, RMS; size of a hidden effect without stated values: moderate and well visible; a
choice."""

OWN_FRICTION: Final = 0.05
"""part of a joint's largest torque, RMS; least size of an effect of the model file itself whose values are unknown: dry
friction of harmonic drives is 5 to 8 % of it; identified at a UR10."""

SIZING_CUTOFF: Final = 40.0
"""Hz; cutoff of filters that sizing does not use, since it runs at full rate; decides no verdict; a choice."""

SPEED: Final = {"revolute": 2.5, "prismatic": 0.3}
"""rad/s, m/s; of a joint whose model file states no limit; a choice."""

RANGE: Final = {"revolute": 1.0, "prismatic": 0.15}
"""rad, m to either side of the middle; of a joint whose model file states no limit; a choice."""

MARGIN: Final = 0.9
"""part of the limits of speed and range that the motion uses; controllers overshoot; a choice."""

AT_REST: Final = 1e-9
"""part of the largest rate; smaller rates are rounding errors; double precision."""

WARM: Final = 24.0
"""degC; temperature at the start where temperatures are recorded; a choice."""

RISE: Final = 20.0
"""K; rise at the end where temperatures are recorded; that of a gear in an hour of work; a choice."""

WARMING: Final = 0.35
"""part of the recording's length; time constant of that rise; a choice."""

SLOW: Final = (0.01, 0.02, 0.04, 0.08, 0.16)
"""parts of the largest speed; of the slow legs, over more than a decade, which Stribeck's curve needs; a choice."""

# the plant ----------------------------------------------------------------------------------------------------------

STEP: Final = 1 / 16_000
"""s; the longest step of the integration, a tenth of a radian of the fastest resonance of a geared joint; accuracy of
the classical Runge-Kutta method."""

FINER: Final = (1, 2, 4, 8)
"""ratios of that step; tried until the step is stable; a choice."""

GROWTH: Final = 1.2
"""ratio; if a mode grows by more within one step, the step is too long; a choice."""

GROWTH_AT: Final = 0.1
"""part of dry friction's width; rate at which the growth is computed: at rest a bristle model is not differentiable; by
construction."""

WEIGHTLESS: Final = 1e-6
"""part of a joint's inertia; with less, the motor before a spring has no inertia, only rounding errors; double
precision."""

RATE_WIDTH: Final = 1e-3
"""rad/s, m/s; half width of the band in which dry friction rises to its full value; a joint at rest creeps more slowly;
a choice."""

POSITION_WIDTH: Final = 1e-5
"""rad, m; half width of the smoothed edge of a plate, an end stop or a spring; a choice."""

FORCE_WIDTH: Final = 1e-3
"""N m, N; half width of the smoothed sign of a load; a choice."""

TIME_WIDTH: Final = 1e-6
"""s; half width of the smoothed instant at which a payload is picked up; a choice."""

SHARP_WIDTH: Final = 1e-12
"""unit of the switch; for effects with states and their joint, whose laws have a finite slope by themselves; by
construction."""

INSTANT: Final = 1e-8
"""s; a step short enough that states without delay take their value at this instant; by
construction."""

NEWTON_STEPS: Final = 3
"""number of Newton steps for accelerations on which an effect depends; quadratic convergence to rounding error; by
construction."""

DRIVE_STEPS: Final = 60
"""number of Newton steps for the torque behind a saturating drive, whose curve is convex: each goes a 15th of the way
in the logarithm, and the command may be 30 times a limit; by construction; a choice."""

LEAST_DIGIT: Final = 1e-10
"""part of the largest number of a row of a motion; what is smaller is rounding, and 0 in a file; ten digits are
written; by construction."""

"""Every number by which a model is fitted and its uncertainty stated, with its unit, its reason and its source.

Where the source says "development recordings", the number was set by hand on simulated recordings with development
seeds (tests/judge), for verdicts and not by a derivation; tests/benchmarks/test_thresholds.py shows what halving and
doubling it does. "By construction" says that another number would contradict how the thing is built.
"""

from __future__ import annotations

from typing import Final

# the skew between torque and motion ---------------------------------------------------------------------------------

HOLD: Final = (-0.25, 1.0)
"""samples; between a torque and the encoder reading beside it that a hold can explain: half a sample for the hold
alone, 0.73 to 0.78 on EMPS, and some room to either side; development and real recordings."""

NOMINAL_SKEW: Final = 0.5
"""samples; a torque that is held from one reading to the next acts half a sample later on the average; the zero-order
hold."""

SKEW_RANGE: Final = (-3.5, 3.5)
"""samples; a skew is looked for within these, for which the band's filter has room; by construction."""

SKEWS_APART: Final = 0.25
"""samples; joints whose skews differ by more, beyond their errors, are not sampled alike, and something delays a
torque; development recordings with delays."""

SOFT_SKEW_PASSES: Final = 8
"""number of steps in which a shift beside a transmission that gives way is sought; each is shortened by the noise of
the torque, to a third at least on development recordings; a choice."""

SKEW_SIGMAS: Final = 4.0
"""standard deviations of white rows; they are smaller than those of rows that hang together, for which so many stand
in; development recordings with delays."""

LONGEST_DELAY: Final = 0.05
"""s; a torque that is recorded further ahead of its motion belongs to no drive: a command over a field bus takes some
cycles of 1 to 10 ms; a choice."""

LONGEST_LAG: Final = 0.02
"""s; likewise for one that is recorded after the motion, as through a current filter of 10 to 100 Hz; a choice."""

DELAY_STEPS: Final = 8.0
"""number of steps a period of the cut-off; between two of them no least error is missed; by construction."""

DELAY_ACCURACY: Final = 0.01
"""parts of such a step; finer, a delay changes no torque within the band; by construction."""

CLEAR_DELAY: Final = 30.0
"""natural logarithm of a likelihood, twice; a joint's torque is taken at another time where that is so much likelier,
as much as an effect must be for its name; by construction."""

SMALL_DELAY: Final = 1.0
"""parts of a radian at the cut-off; a delay that is shorter is taken to first order in the torque that is predicted; by
construction."""

# the search for shapes ----------------------------------------------------------------------------------------------

PREDICTION_PASSES: Final = 8
"""number of fits; an effect that reads the predicted torque is fitted again with the prediction that it improved,
unless that moves nothing; development recordings."""

SAME_PREDICTION: Final = 1e-3
"""part of a coefficient; a prediction that moves none by more is as good as the one before; development recordings."""

SAME_RESIDUAL: Final = 2e-3
"""part of a joint's residual; a prediction that moves it by less is as good as the one before: over 2500 rows all
coefficients together move by a tenth of a standard deviation; by construction."""

SEARCH_STEP: Final = 1e-4
"""part of a grid's stretch; over it a derivative by a shape is taken, and a search that moves less has ended; between
rounding and curvature."""

SAME_ERROR: Final = 1e-10
"""part of the squared error; shapes whose errors differ by less are as good as each other; double precision."""

SEARCH_FALL: Final = 1e-6
"""part of the squared error; a search whose fall is less has ended; development recordings."""

SEARCH_EVALUATIONS: Final = 12
"""number of residuals, derivatives not counted; a grid has brought the start near; development recordings."""

SEARCH_INSIDE: Final = 1e-6
"""part of a grid's stretch; a search begins so far inside its bounds, which its method asks for; by construction."""

# the width of a gap -------------------------------------------------------------------------------------------------

GAP_REACH: Final = 2.5
"""ratio; so far to either side of where a search over candidates left it the width of a gap is sought: that search has
steps of 2; by construction."""

GAP_STEPS: Final = 6
"""number of steps to either side; in steps of a sixth the least error is not missed among those that chance makes;
development recordings with backlash."""

GAP_ACCURACY: Final = 0.2
"""parts of such a step; finer, the width is chance; development recordings with backlash."""

AS_GOOD_A_FLANK: Final = 1.05
"""ratio of errors, RMS; flanks that leave no more may be the true ones: what is simulated without what lies above the
band leaves a twentieth more or less; development recordings with backlash."""

HOPELESS_FLANK: Final = 1.5
"""ratio of errors, RMS; flanks that leave more with the width that was found are as good at none; development
recordings with backlash."""

# uncertainty --------------------------------------------------------------------------------------------------------

INTERVAL_SIGMAS: Final = 1.96
"""standard deviations; the half of a 95 % interval; normal distribution."""

SCORE_BLOCK_S: Final = 1.0
"""s; residuals further apart than that are taken to be independent: long against the band's filter and the noise of
most sensors; development recordings."""

SEPARABLE: Final = 1e-4
"""ratio of singular values of the scaled Jacobian; a direction below is not told by the data; development recordings
with short motions."""

TANGLED_SHARE: Final = 0.2
"""part of an unseen direction of length 1; an unknown with more of it can only be told together with the others;
development recordings."""

ROTOR_STEP: Final = 1e-3
"""part of a rotor's inertia; a step for a derivative, far above rounding; numerical analysis."""
SMOOTHING_BIAS: Final = 0.5
"""standard deviations per shift of a parameter between a load that is smoothed and one that keeps the encoder's noise;
the truth lies between the two, which a 95 % interval of that width holds; development recordings with elasticity."""

WHITENED_BIAS: Final = 1.5
"""standard deviations per shift of a parameter between plain and whitened rows; whitening takes a third to all of the
bias away; development recordings with elasticity and a disturbance on the link."""

SHAPE_STEP: Final = 1e-3
"""part of a shape's value (its unit where that is 0); over it a derivative is taken; between rounding and curvature."""

VALUE_STEP: Final = 1e-5
"""part of a coefficient; over it a declared parameter's derivative is taken, which is a smooth function in closed form;
between rounding and curvature."""

VALUE_STEP_AT_0: Final = 1e-8
"""unit of the coefficient; the same step where the coefficient is 0; between rounding and curvature."""

# the twist of a transmission ----------------------------------------------------------------------------------------

TWIST_PASSES: Final = 2
"""number of steps of Gauss and Newton; the shift between two encoders is short against any motion in the band, and the
second step moves it by a thousandth; by construction."""

LARGEST_QUANTILE: Final = 0.99
"""part of all rows; the largest transmitted torque without single peaks; a choice."""

LOADED: Final = 0.25
"""part of the largest transmitted torque; above it a gap's flanks surely touch; development recordings with link-side
encoders."""

# the inertia --------------------------------------------------------------------------------------------------------

INERTIA_CONFIGURATIONS: Final = 60
"""number of configurations a piece; D must be positive definite at them: it changes slowly with the posture;
development recordings."""

ROTOR_ASSUMED: Final = 0.5
"""part of the inertia into which a rotor's is merged; what the derived equations take for it (symbolic/model.py); the
gear that accelerates its load best makes rotor and load equal, Pasch & Seering 1984."""

ROTOR_SHARES: Final = (0.02, 0.98)
"""parts of that inertia; between them a rotor is looked for, so that on either side something is left; by
construction."""

NEUTRAL_INERTIA: Final = 1e-6
"""unit kg m² or kg; an inertia that the model file leaves out begins there, and stays where no row tells it, so that D
is positive definite; less than any joint moves, more than the rounding of D's eigenvalues; by construction."""

HARDLY_POSITIVE: Final = 0.01
"""part of the smallest eigenvalue of D that the model file or the torques give; a fit below it stopped at the bound
of what is physical; development recordings."""

# the limits of compensation -----------------------------------------------------------------------------------------

MOST_COMPENSATED: Final = 0.5
"""part of a power; so much of a column, or of a torque, may be the encoders' noise: beyond, what is left is smaller
than what was taken off, and its sign is chance; by construction, and development recordings with coarse encoders."""

FAR_WORSE: Final = 2.0
"""ratio of squared errors; noise that is half of a column makes plain least squares leave half of what the truth does,
and more than that is not compensated; errors in variables, by construction."""

LOWERED_TO: Final = 0.7071
"""part of a cut-off; the next cut-off tried where a band lets too much noise in: the noise of an acceleration falls to
a sixth; a choice."""

# over what a residual is structured ---------------------------------------------------------------------------------

STRUCTURE_BINS: Final = 24
"""bins of equal count; a curve over a signal may turn a dozen times; development recordings."""

STRUCTURE_LEAST_SHARE: Final = 0.02
"""part of the residual's variance; a signal that explains less is not named; development recordings."""

# wrong data ---------------------------------------------------------------------------------------------------------

SUSPECTED_FROM: Final = 0.05
"""part of a joint's torque; a smaller residual is that of right data: with a wrong sign, unit or joint more of inertia
and friction remains; by construction, and development recordings."""

TURNED_FALLS_TO: Final = 0.8
"""part of a joint's error; to less it must fall with the other sign, or in degrees, before data are suspected: with
right data it rises, as inertia and friction reach their bounds; development and real recordings."""

EXCHANGED_FALLS_TO: Final = 0.6
"""part of a joint's error; to less both must fall with two joints exchanged: motions of neighbours are similar;
development and real recordings."""

SUSPECTED_RATIO: Final = 20.0
"""ratio of an inertia to the file's, or of a gear; a smaller one may be a bad guess: inertias that users guess are
wrong by factors of 2 to 5; real recordings."""

FACTOR_OF_INERTIA: Final = 2.0
"""ratio; within it a wrong inertia must equal the gear ratio, or the degrees in a radian, to be explained by it: data
sheets are as uncertain; a choice."""

DOUBTED_RATIO: Final = 8.0
"""ratio of an inertia to the file's; from it a mistake is mentioned without a verdict, as guesses are wrong by factors
of 2 to 5; real recordings."""

# friction outside the data ------------------------------------------------------------------------------------------

FRICTION_RANGE: Final = 4
"""ratio to the fastest speed of the data; up to it a friction that drives its joint is warned of; a choice."""

# lines over the motor's angle ---------------------------------------------------------------------------------------

SLOWEST_ROWS: Final = 0.1
"""part of the rows, the slowest; an order is looked for if it is in the band at these: enough for its order and
amplitude; a choice."""

MIDDLE_OF_SPEEDS: Final = (0.02, 0.98)
"""parts of the way; the speeds between them give the frequencies of a line; a choice."""

SLOPE_STEP: Final = 1e-4
"""rad, m and rad/s, m/s; torques so far to either side give how they grow with a position or a rate: their curvature
adds a part of 1e-8, rounding one of 1e-11; by construction."""

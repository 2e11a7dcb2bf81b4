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

SKEW_SIGMAS: Final = 4.0
"""standard deviations of white rows; they are smaller than those of rows that hang together, for which so many stand
in; development recordings with delays."""

# the search for shapes ----------------------------------------------------------------------------------------------

PREDICTION_PASSES: Final = 3
"""number of fits; an effect that reads the predicted torque is fitted again with the prediction that it improved,
unless that moves nothing; development recordings."""

SAME_INERTIA: Final = 1e-3
"""part of an inertial parameter; a prediction that moves it by less is as good as the one before; development
recordings."""

SEARCH_STEP: Final = 1e-4
"""part of a grid's stretch; over it a derivative by a shape is taken, and a search that moves less has ended; between
rounding and curvature."""

SEARCH_FALL: Final = 1e-6
"""part of the squared error; a search whose fall is less has ended; development recordings."""

SEARCH_EVALUATIONS: Final = 12
"""number of residuals, derivatives not counted; a grid has brought the start near; development recordings."""

SEARCH_INSIDE: Final = 1e-6
"""part of a grid's stretch; a search begins so far inside its bounds, which its method asks for; by construction."""

GRID_EDGE: Final = 0.02
"""part of a grid's stretch; a shape nearer to an end was not found but stopped there; development recordings."""

# cross-validation ---------------------------------------------------------------------------------------------------

FOLDS: Final = 10
"""number of stretches of time; each is left out once; the usual number (Kohavi 1995)."""

# uncertainty --------------------------------------------------------------------------------------------------------

INTERVAL_SIGMAS: Final = 1.96
"""standard deviations; the half of a 95 % interval; normal distribution."""

SCORE_BLOCK_S: Final = 1.0
"""s; residuals further apart than that are taken to be independent: long against the band's filter and the noise of
most sensors; development recordings."""

MOST_LAGS: Final = 12
"""rows; the longest autoregression that whitens a residual: some periods of the cut-off; development recordings."""

SEPARABLE: Final = 1e-4
"""ratio of singular values of the scaled Jacobian; a direction below is not told by the data; development recordings
with short motions."""

TANGLED_SHARE: Final = 0.2
"""part of an unseen direction of length 1; an unknown with more of it can only be told together with the others;
development recordings."""

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

HARDLY_POSITIVE: Final = 0.01
"""part of the smallest eigenvalue of the file's own D; a fit that has less stopped at the bound of what is physical;
development recordings."""

# over what a residual is structured ---------------------------------------------------------------------------------

STRUCTURE_BINS: Final = 24
"""bins of equal count; a curve over a signal has room for a dozen turns; development recordings."""

STRUCTURE_LEAST_SHARE: Final = 0.02
"""part of the residual's variance; a signal that explains less is not named; development recordings."""

# friction outside the data ------------------------------------------------------------------------------------------

FRICTION_RANGE: Final = 4
"""ratio to the fastest speed of the data; up to it a friction that drives its joint is warned of; a choice."""

FRICTION_SPEEDS: Final = 400
"""number of speeds; a hundred between rest and the fastest of the data; by construction."""

# least squares: numerics --------------------------------------------------------------------------------------------

RANK: Final = 1e-9
"""ratio of eigenvalues of a scaled Gram matrix; a direction below is rounding; double precision, squared columns."""

WELL_POSED: Final = 1e-3
"""smallest pivot, a ratio, of a scaled Cholesky factor; below, directions may be unseen, and eigenvalues are asked; far
above the root of RANK, so that both ways agree."""

OPTIMAL: Final = 1e-10
"""part of the largest moment per column's size; where the cost falls by less towards the inside, a bound is kept;
double precision."""

INERTIA_CUTS: Final = 30
"""number of cutting planes; each is a posture at which D was not positive definite; an end to the search that good data
never reach; a choice."""

INERTIA_MARGIN: Final = 1e-6
"""length of a scaled cut, a ratio; D stays so far from the bound, as the solver is no more exact; by construction."""

SOLVER_ACCURACY: Final = 1e-8
"""part of the largest coefficient; nearer to a bound the solver means the bound; its own tolerance."""

RIDGES: Final = (1e-12, 1e-9, 1e-6)
"""parts of the mean curvature; makes directions that the data do not see unique and moves nothing that they do see. The
solver gives up where a Hessian is singular to rounding, or is not positive definite after the noise is taken off: then
the next is tried; double precision."""

# memory -------------------------------------------------------------------------------------------------------------

KEPT_SYSTEMS: Final = 8
"""number of equations a joint; kept for searches that come back to a shape; memory, it decides no result."""

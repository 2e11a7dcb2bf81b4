"""Every number of the linear regression, with its unit, its reason and its source."""

from __future__ import annotations

from typing import Final

# rows that hang together ---------------------------------------------------------------------------------------------

FOLDS: Final = 10
"""number of stretches of time; each is left out once; the usual number (Kohavi 1995)."""

MOST_LAGS: Final = 12
"""rows; the longest autoregression that whitens a residual: some periods of the cut-off; development recordings."""

WHITE_LEAST: Final = 1e-2
"""part of a residual's variance that counts as white; rows end above the band, where its filter leaves less and less of
noise and of what the model says, and smoothing takes some of that: what is weaker is not made the most of; the white
noise correction of linear prediction, where the band's filter leaves a hundredth."""

LEAST_UNKNOWN: Final = 1e-4
"""part of a row; an unknown combination of rows of which less is left counts for nothing; rounding."""

# columns -------------------------------------------------------------------------------------------------------------

LEAST_OWN: Final = 1e-4
"""part of a column's square; so much the base must leave of it for the column to count as the candidate's own: a
hundredth of its size; development recordings."""

SHRINKAGE: Final = 0.01
"""part of what all rows tell of an effect's coefficient; so much speaks for zero where a stretch is left out: where the
rest tells a hundredth, as of a stop that is only brushed there, its noise does not decide; where it tells nine tenths,
the coefficient moves by a hundredth; a choice, and simulated recordings of a stop touched once and brushed once."""

LARGEST_COLUMN: Final = 1e100
"""unit of the column; beyond it a simulation has overflown, and squares soon do; double precision."""

# least squares: numerics ---------------------------------------------------------------------------------------------

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

RIDGE: Final = 1e-12
"""part of the mean curvature; makes directions that the data do not see, or that are not positive after the noise is
taken off, unique and moves nothing that they do see; double precision."""

KEPT_ENDS: Final = 4
"""number of sets; so many, of coefficients that ended on bounds, are tried on problems like these; time."""

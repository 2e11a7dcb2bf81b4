"""Every number of the linear regression, with its unit, its reason and its source."""

from __future__ import annotations

from typing import Final

# rows that hang together ---------------------------------------------------------------------------------------------

FOLDS: Final = 10
"""number of stretches of time; sums over them count as independent; the usual number (Kohavi 1995)."""

MOST_LAGS: Final = 12
"""rows; the longest autoregression that whitens a residual: some periods of the cut-off; development recordings."""

WHITE_LEAST: Final = 1e-2
"""part of a residual's variance that counts as white; rows end above the band, where its filter leaves less and less of
noise and of what the model says, and smoothing takes some of that: what is weaker is not made the most of; the white
noise correction of linear prediction, where the band's filter leaves a hundredth."""

# columns -------------------------------------------------------------------------------------------------------------

LEAST_OWN: Final = 1e-4
"""part of a column's square; so much the base must leave of it for the column to count as the candidate's own: a
hundredth of its size; development recordings."""

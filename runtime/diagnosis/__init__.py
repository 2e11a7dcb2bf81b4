"""From the residual of a fitted model to named effects, or to silence."""

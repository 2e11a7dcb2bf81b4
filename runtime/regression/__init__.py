"""Linear systems: bounded least squares, cross-validation, whitening."""

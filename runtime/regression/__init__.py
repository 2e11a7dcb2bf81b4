"""Linear systems: bounded least squares, whitening."""

"""Motion and springs together: trajectories, scenarios and their optimization."""

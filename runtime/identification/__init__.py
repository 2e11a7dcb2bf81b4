"""Regressors, least squares and intervals: identification and comparison."""

"""Motions that make rival effects distinguishable."""

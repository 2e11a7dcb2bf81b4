"""Simulation of arms, with hidden effects."""

"""Figures of results, recordings and plans."""

"""Expressions as straight-line tapes, and what every target prints of them."""

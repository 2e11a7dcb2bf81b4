"""Identified arms for other programs: base parameters become bodies that can be."""

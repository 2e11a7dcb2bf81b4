"""Identification, comparison and diagnosis against the generated code; never imports SymPy."""

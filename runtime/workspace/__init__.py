"""A user's arm: its model file read, edited, compiled and exported. Command line, notebooks and pages go through it.

Everything heavy (SymPy, CasADi, SciPy) is imported where it is needed, so that --help is quick.
"""

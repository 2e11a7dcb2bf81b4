"""Generated code held against SymPy."""

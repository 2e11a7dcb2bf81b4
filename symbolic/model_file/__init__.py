"""The model file: read, checked, edited; free of SymPy."""

"""The generated code of an arm and of the effects, loaded for NumPy and CasADi."""

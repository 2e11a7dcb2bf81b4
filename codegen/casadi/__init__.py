"""CasADi of symbolic functions: smooth forms for the optimizer."""

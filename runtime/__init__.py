"""Identification, comparison and diagnosis against the generated code; never imports SymPy."""

import os

# The matrices are small: threads of the linear algebra library would only wait for each other. The variable must be set
# before NumPy is imported; a value from the environment is kept.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

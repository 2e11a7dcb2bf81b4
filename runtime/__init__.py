"""Identification, comparison and diagnosis against the generated code; never imports SymPy."""

import os

# The matrices here are small: threads of the linear algebra library would only wait for each other. This
# must be said before NumPy is imported; who says otherwise in the environment is heard.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

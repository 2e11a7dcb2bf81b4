"""The loop in a browser: compare, see where the model fails, name it, add it, watch the error fall."""

"""The verbs for notebooks and scripts; imported as `tendon`."""

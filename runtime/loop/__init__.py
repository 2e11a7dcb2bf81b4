"""The whole loop: add what is missing, refit, judge on what was not fitted."""

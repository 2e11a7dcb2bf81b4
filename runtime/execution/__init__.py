"""Planned motions on an arm: the controller, the simulated arm, the recording of what happened."""

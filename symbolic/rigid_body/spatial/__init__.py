"""Chains in space: their geometry, the recursion that is emitted, base parameters, closed forms, kinematics."""

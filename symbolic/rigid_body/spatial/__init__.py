"""Serial chains in space: their recursion, base parameters, matrices and kinematics, and the Lagrangian that proves them."""

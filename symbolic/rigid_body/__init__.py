"""T and V to D, C and g; the recursion that is emitted; base parameters; kinematics."""

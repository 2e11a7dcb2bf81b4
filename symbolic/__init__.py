"""The equations: everything that Tendon knows about mechanics, in SymPy and nothing else."""

"""The study of the paper: its tables and figures, ours beside the published ones."""

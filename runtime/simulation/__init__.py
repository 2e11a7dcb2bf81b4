"""Arms that are simulated, with hidden effects if wanted."""

"""Recordings as the model sees them: band, derivatives, repeats, noise floor."""

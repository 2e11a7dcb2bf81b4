"""A recording becomes a motion: one even grid, a band a joint, filters, derivatives, repeats, noise floor."""

"""Many optimizations of one scenario: a grid of variations, run anywhere, kept as they finish, in one table."""

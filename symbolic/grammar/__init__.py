"""The terms from which a law is drafted that is not in the library."""

"""Results in words, figures, a page and on the terminal."""

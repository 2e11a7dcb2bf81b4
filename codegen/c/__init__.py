"""C99 of symbolic functions, of the effects and of the controller."""

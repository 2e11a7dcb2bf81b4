"""Compilers, and what they make: shared libraries for the host, images for boards."""

"""Rust of symbolic functions: what a further language takes."""

"""Recordings read, checked and written, in SI."""

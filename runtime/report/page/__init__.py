"""The page of a result: one HTML file."""

NAME = "report.html"
"""Of the page's file, in the directory that is asked for."""

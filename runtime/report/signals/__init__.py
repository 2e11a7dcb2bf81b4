"""Signals of a joint on canvases that zoom, pan and share a selection.

Python reduces the signals to a few thousand numbers a view; static/signals.js draws them, in a report (runtime/report/
page) and in the studio.
"""

from pathlib import Path

STATIC = Path(__file__).parent / "static"
EMBEDDED_SCRIPTS = ("scales.js", "sources.js", "drawing.js", "toolbar.js", "gestures.js", "signals.js")
"""Scripts of a page with embedded signals, in order: each uses those before it."""
SCRIPTS = ("scales.js", "sources.js", "served.js", "drawing.js", "toolbar.js", "gestures.js", "signals.js")
"""Scripts of a page that asks a server for signals."""
STYLES = ("colours.css", "signals.css")

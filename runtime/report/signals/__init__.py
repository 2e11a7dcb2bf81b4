"""Signals to look into: a joint's torques and residual on canvases that zoom, pan and select together.

What a canvas draws is reduced here, to a few thousand numbers a view; static/signals.js draws it, in a page that stands
alone (runtime/report/page) and in one that is served.
"""

from pathlib import Path

STATIC = Path(__file__).parent / "static"
EMBEDDED_SCRIPTS = ("scales.js", "sources.js", "drawing.js", "telling.js", "gestures.js", "signals.js")
"""Of a page that has the numbers in itself, in their order: each leans on those before it."""
SCRIPTS = ("scales.js", "sources.js", "served.js", "drawing.js", "telling.js", "gestures.js", "signals.js")
"""Of a page that asks a server for them."""
STYLES = ("colours.css", "signals.css")

"""A page with nothing but signals in it, served on this machine, for tests and benchmarks of the canvas."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread
from urllib.parse import parse_qsl, urlsplit

from runtime.report.signals import SCRIPTS, STATIC, STYLES
from runtime.report.signals.signal_set import AskedWrongly, SignalSet

HEAD = "".join(f'<link rel="stylesheet" href="/static/{name}">' for name in STYLES)
BODY = "".join(f'<script src="/static/{name}"></script>' for name in SCRIPTS)
STYLE = "body{margin:1rem;background:var(--paper);color:var(--ink);font:1rem/1.5 system-ui,sans-serif}"


def page(names: list[str]) -> str:
    """HTML with the signals of every set."""
    shown = "".join(f'<tendon-signals src="/data/{name}"></tendon-signals>' for name in names)
    head = f'<meta charset="utf-8"><meta name="viewport" content="width=device-width"><title>signals</title>{HEAD}'
    return f'<!doctype html><html lang="en"><head>{head}<style>{STYLE}</style></head><body>{shown}{BODY}</body></html>'


@contextmanager
def served(sets: Mapping[str, SignalSet]) -> Iterator[str]:
    """Address of a page that shows the sets one below the other."""

    class Answers(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            place = urlsplit(self.path)
            parts = place.path.strip("/").split("/")
            try:
                body, kind = answer(parts, dict(parse_qsl(place.query)))
            except (AskedWrongly, KeyError, OSError) as wrong:
                self.send_error(400, str(wrong))
                return
            self.send_response(200)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *_: object) -> None:
            """Quiet: a test's output is its own."""

    def answer(parts: list[str], query: dict[str, str]) -> tuple[bytes, str]:
        if parts[0] == "data":
            return sets[parts[1]].answer(parts[2], query)
        if parts[0] == "static":
            kind = "text/css" if parts[1].endswith(".css") else "text/javascript"
            return (STATIC / parts[1]).read_bytes(), kind
        return page(list(sets)).encode(), "text/html; charset=utf-8"

    server = ThreadingHTTPServer(("127.0.0.1", 0), Answers)
    Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.server_port}/"
    finally:
        server.shutdown()
        server.server_close()

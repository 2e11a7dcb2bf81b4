"""The studio's server: the page, the signals of its drawings, uploads and downloads.

Only this module and the page import NiceGUI, which is an extra.
"""

from __future__ import annotations

import importlib.util
import os
import secrets
import socket
import sys
import webbrowser
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from runtime.report.page.html import policy
from runtime.report.signals.signal_set import AskedWrongly, SignalSet
from runtime.studio.session import SessionError, safe_name
from runtime.studio.settings import MOST_REQUEST, MOST_SETS, TOKEN_BYTES
from runtime.studio.studio import Studio
from runtime.studio.work import WorkError

if TYPE_CHECKING:
    from fastapi import FastAPI

HOST = "127.0.0.1"
GIVEN = "/given"
_DOWNLOADED = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; sandbox"
"""Policy of a file of the session that a browser shows: the folder may come from somebody else."""


class StudioError(RuntimeError):
    """A server that cannot be started; the message says why and what to do."""


def needed() -> None:
    """Raises StudioError where NiceGUI is not installed."""
    if importlib.util.find_spec("nicegui") is None:
        raise StudioError(
            "the studio needs NiceGUI, the extra `studio` (pip install -e '.[studio]'); "
            f"run: {sys.executable} -m pip install 'nicegui>=3'"
        )


def serve(studio: Studio, listening: socket.socket, say: Callable[[str], None], browser: bool) -> None:
    """Serve a session until Ctrl-C.

    listening  a socket from `bound`
    say        called with the address
    browser    open the address in the browser
    """
    import uvicorn

    from runtime.studio.guard import Guard

    port, token = listening.getsockname()[1], secrets.token_urlsafe(TOKEN_BYTES)
    # The folder in which NiceGUI keeps what belongs to a user.
    os.environ["NICEGUI_STORAGE_PATH"] = str(studio.session.folder / "browser")
    config = uvicorn.Config(
        Guard(application(studio), token, port, [GIVEN]),
        log_level="warning",
        access_log=False,
        server_header=False,
        date_header=False,
        ws_max_size=MOST_REQUEST,
        timeout_graceful_shutdown=1,
    )
    address = f"http://{HOST}:{port}/?token={token}"
    say(address)
    start = studio.session.folder / "open.html"
    try:
        if browser:
            write_start_file(start, address)
            webbrowser.open(start.as_uri())
        uvicorn.Server(config).run([listening])
    finally:
        start.unlink(missing_ok=True)
        studio.close()


def write_start_file(path: Path, address: str) -> None:
    """A file that opens an address, readable by its owner alone: everyone on the machine can read a command line."""
    path.unlink(missing_ok=True)
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as out:
        out.write(f'<!doctype html><title>Tendon studio</title><meta http-equiv="refresh" content="0;url={address}">\n')


def bound(port: int) -> socket.socket:
    """A socket that listens on a port of this machine; 0: any free one. Raises StudioError."""
    listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((HOST, port))
        listening.listen()  # requests before the server is ready wait, and are not refused
    except OSError as error:
        listening.close()
        raise StudioError(
            f"port {port} of {HOST} cannot be used: {error.strerror}; choose another with --port"
        ) from error
    return listening


def application(studio: Studio) -> FastAPI:
    """Everything that is served, without the guard."""
    from fastapi import FastAPI
    from nicegui import ui
    from starlette.staticfiles import StaticFiles

    from runtime.studio.page.page import build

    app = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
    _add_routes(app, studio)
    home = Path(__file__).parent.parent
    app.mount("/static/signals", StaticFiles(directory=home / "report" / "signals" / "static"))
    app.mount("/static/page", StaticFiles(directory=home / "studio" / "page" / "static"))

    @ui.page("/")
    def page() -> None:
        build(studio)

    ui.run_with(
        app,
        title="Tendon studio",
        dark=None,
        tailwind=False,
        show_welcome_message=False,
        gzip_middleware_factory=None,  # the guard reads the pages
    )
    return app


def _add_routes(app: FastAPI, studio: Studio) -> None:
    """Everything beside the page."""
    from fastapi import Request
    from starlette.responses import PlainTextResponse, Response

    @lru_cache(maxsize=MOST_SETS)
    def loaded(path: Path, _changed: int) -> SignalSet:
        """Kept in memory for as long as the file is the same."""
        return SignalSet.load(path)

    def data(request: Request) -> Response:
        found = studio.signals(request.path_params["name"])
        if found is None:
            return PlainTextResponse("there is no such signal set\n", 404)
        try:
            kept = loaded(found, found.stat().st_mtime_ns)
            body, kind = kept.answer(request.path_params["what"], dict(request.query_params))
        except (AskedWrongly, OSError, ValueError, KeyError) as error:
            return PlainTextResponse(f"{error}\n", 400)
        return Response(body, media_type=kind, headers={"cache-control": "no-store"})

    async def given(request: Request) -> Response:
        role, name = request.query_params.get("as", ""), request.query_params.get("name", "")
        try:
            await studio.receive(role, name, request.stream())
        except (SessionError, WorkError) as error:
            return PlainTextResponse(f"{error}\n", 413 if "larger" in str(error) else 400)
        return Response(status_code=204)

    def download(request: Request) -> Response:
        try:
            name, body, kind = _file(studio, request.path_params["what"], int(request.query_params.get("step", "")))
        except ValueError as error:
            return PlainTextResponse(f"{error}\n", 404)
        headers = {"content-disposition": f'attachment; filename="{name}"', "content-security-policy": _DOWNLOADED}
        return Response(body, media_type=kind, headers=headers)

    def plan(request: Request) -> Response:
        number = request.path_params["number"]
        path = studio.session.plan(int(number)) / "page.html" if number.isdecimal() else None
        if path is None or not path.is_file():
            return PlainTextResponse("there is no such plan\n", 404)
        page = path.read_text(encoding="utf-8")
        # Its scripts run in an origin of their own: they cannot act on the session, whoever wrote the page.
        headers = {"content-security-policy": f"{policy(page)}; sandbox allow-scripts"}
        return Response(page, media_type="text/html", headers=headers)

    app.add_route("/data/{name}/{what}", data, ["GET"])
    app.add_route(GIVEN, given, ["POST"])
    app.add_route("/download/{what}", download, ["GET"])
    app.add_route("/plan/{number}", plan, ["GET"])


def _file(studio: Studio, what: str, step: int) -> tuple[str, bytes, str]:
    """Name, content and type of a download. Raises ValueError."""
    if what == "model":
        name = "model.toml" if studio.inputs.model is None else safe_name(studio.inputs.model.name)
        return name, studio.model_text(step).encode(), "application/toml"
    if what == "commands":
        lines = ["#!/bin/sh", *studio.commands(step)]
        return "commands.sh", ("\n".join(lines) + "\n").encode(), "text/x-shellscript"
    known = {"motion": ("motion.csv", "text/csv")}
    known |= {page: (f"{page}.html", "text/html") for page in ("report", "replay")}
    name, kind = known.get(what, ("", ""))
    path = studio.file(step, name) if name else None
    if path is None:
        raise ValueError("there is no such file")
    return f"{path.stem}-{step}{path.suffix}", path.read_bytes(), kind

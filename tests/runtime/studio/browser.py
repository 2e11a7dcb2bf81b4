"""A real browser, and `tendon studio` in a process of its own."""

from __future__ import annotations

import contextlib
import http.client
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest

from tests.runtime.studio.waiting import PATIENCE, until

ROOT = Path(__file__).resolve().parents[3]
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")


def launched() -> Iterator[Any]:
    """A browser without a window; the test is skipped, with the reason, where there is none."""
    playwright = pytest.importorskip("playwright.sync_api", reason="no browser: pip install playwright")
    if CHROMIUM is None:
        pytest.skip("no browser: apt-get install chromium")
    with playwright.sync_playwright() as started:
        browser = started.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"], timeout=1000 * PATIENCE)
        try:
            yield browser
        finally:
            browser.close()


@dataclass
class Server:
    """A running studio: its address with the token, and the folder in which it was started."""

    address: str
    folder: Path

    @property
    def host(self) -> str:
        return urlsplit(self.address).netloc

    @property
    def token(self) -> str:
        return urlsplit(self.address).query.removeprefix("token=")

    def hold_task(self) -> None:
        """Stop the process that works, so that its task cannot end; cancelling the task kills it."""
        until(lambda: self._worker() is not None)
        os.kill(self._worker(), signal.SIGSTOP)

    def _worker(self) -> int | None:
        """The process that works for this server; None if there is none yet."""
        for place in Path("/proc").glob("[0-9]*"):
            with contextlib.suppress(OSError):
                command = (place / "cmdline").read_bytes().split(b"\0")
                if b"runtime.studio.worker" in command and any(str(self.folder).encode() in part for part in command):
                    return int(place.name)
        return None

    @cached_property
    def cookie(self) -> str:
        """The cookie for which the address is exchanged."""
        connection = http.client.HTTPConnection(self.host, timeout=PATIENCE)
        connection.request("GET", f"/?token={self.token}")
        answer = connection.getresponse()
        assert (answer.status, answer.getheader("location")) == (303, "/")
        connection.close()
        return str(answer.getheader("set-cookie")).partition(";")[0]


def served(folder: Path, *arguments: object) -> Iterator[Server]:
    """`tendon studio ARGUMENTS`, run in a folder and ended afterwards."""
    pytest.importorskip("nicegui", reason="no studio: pip install -e '.[studio]'")
    command = [sys.executable, "-c", "from runtime.cli.main import main; main()", "studio", "--no-browser"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": "1"}
    with (folder / "studio.log").open("w") as log:
        process = subprocess.Popen(
            [*command, *map(str, arguments)], cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=log, text=True
        )
        assert process.stdout is not None
        try:
            said = next((found for line in process.stdout if (found := re.search(r"http://\S+", line))), None)
            assert said is not None, (folder / "studio.log").read_text()
            yield Server(said[0], folder)
        finally:
            process.terminate()
            try:
                process.wait(PATIENCE)
            except subprocess.TimeoutExpired:
                process.kill()
            process.stdout.close()


class Watched:
    """A page, with all requests that it sent and all errors in it."""

    def __init__(self, browser: Any, address: str, width: int = 1360, scheme: str = "light") -> None:
        self.context = browser.new_context(
            viewport={"width": width, "height": 950}, color_scheme=scheme, reduced_motion="reduce"
        )
        self.context.set_default_timeout(1000 * PATIENCE)
        self.page = self.context.new_page()
        self.asked: list[str] = []
        self.wrong: list[str] = []
        self.page.on("request", lambda request: self.asked.append(request.url))
        self.page.on("websocket", lambda socket: self.asked.append(socket.url))
        self.page.on("pageerror", lambda error: self.wrong.append(str(error)))
        self.page.on("console", lambda said: self.wrong.append(said.text) if said.type == "error" else None)
        self.page.goto(address)

    def at_step(self, number: int) -> Any:
        """The page, once it shows a step."""
        self.page.click(f"[data-step='{number}']:not([disabled])")
        self.page.wait_for_selector(f"[data-step='{number}'][aria-current=step]")
        return self.page

    def emptied(self) -> Any:
        """The page, once its session has no recordings: what needs the start page begins here."""
        self.page.wait_for_selector("#plans h2")
        if self.page.locator("#afresh summary").count():
            self.page.click("#afresh summary")
            self.page.click("[data-do=afresh]:not([disabled])")
        self.page.wait_for_selector("#start h1")
        while count := self.page.locator("#recordings article").count():
            self.page.click("#recordings [data-do=remove]")
            self.page.locator("#recordings article").nth(count - 1).wait_for(state="detached")
        return self.page

    def error(self) -> float:
        """Of the current step, per cent: the last figure beside the first bar."""
        return float(re.findall(r"([\d.]+)\s%", self.page.inner_text(".bar-row.fitted .bar-value"))[-1])

    def slow(self) -> Delayed:
        """The page opened again, through a connection whose messages from the server can be delayed."""
        return Delayed(self.page)

    def outside(self) -> list[str]:
        """Requests to other hosts than the studio."""
        own = re.compile(r"(http|ws)://127\.0\.0\.1:\d+/|data:|blob:")
        return [url for url in self.asked if not own.match(url)]


class Delayed:
    """A connection whose messages from the server are delayed: the page shows an old state, as a slow one does."""

    def __init__(self, page: Any) -> None:
        self._page, self._held = page, False
        self._kept: list[str] = []
        page.route_web_socket(re.compile("_nicegui_ws"), self._connect)
        page.reload()

    def _connect(self, socket: Any) -> None:
        def heard(message: str) -> None:
            if self._held and message.startswith("42"):  # an event; the connection's own messages keep it alive
                self._kept.append(message)
            else:
                socket.send(message)

        self._socket = socket
        socket.connect_to_server().on_message(heard)

    def keep(self) -> None:
        """Delay the messages from now on."""
        self._held = True

    def wait(self, what: str, times: int = 1) -> None:
        """Wait until so many delayed messages contain a text."""
        end = time.monotonic() + PATIENCE
        while sum(what in message for message in self._kept) < times:
            assert time.monotonic() < end
            self._page.wait_for_timeout(20)

    def let_go(self) -> None:
        """Send the delayed messages, in their order."""
        while self._kept:
            self._socket.send(self._kept.pop(0))
        self._held = False

"""The verb itself, asked over HTTP and its socket: by the user's browser, by other sites, by programs."""

from __future__ import annotations

import base64
import http.client
import json
import os
import socket
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from runtime.cli import output
from runtime.cli.main import app
from tests import one_joint
from tests.studio import browser

MODEL = one_joint.model_text("[joint.effects.coulomb]\n[joint.effects.viscous]\n")


@dataclass
class Server:
    """A running studio, its session's folder, and the cookie that its address was exchanged for."""

    host: str
    cookie: str
    token: str
    folder: Path

    def ask(
        self, path: str, method: str = "GET", body: object = None, **headers: str
    ) -> tuple[int, dict[str, str], bytes]:
        given = {"Cookie": self.cookie} | {name.replace("_", "-"): value for name, value in headers.items()}
        connection = http.client.HTTPConnection(self.host, timeout=30)
        try:
            connection.request(method, path, body, given)  # type: ignore[arg-type]
            answer = connection.getresponse()
            return answer.status, {k.lower(): v for k, v in answer.getheaders()}, answer.read()
        finally:
            connection.close()

    def shake(self, **headers: str) -> int:
        """The status of the beginning of a socket."""
        host, _, port = self.host.partition(":")
        given = {
            "Host": self.host,
            "Cookie": self.cookie,
            "Upgrade": "websocket",
            "Connection": "Upgrade",
            "Sec-WebSocket-Version": "13",
            "Sec-WebSocket-Key": base64.b64encode(os.urandom(16)).decode(),
            **headers,
        }
        lines = [
            "GET /_nicegui_ws/socket.io/?EIO=4&transport=websocket HTTP/1.1",
            *(f"{k}: {v}" for k, v in given.items()),
        ]
        with socket.create_connection((host, int(port)), timeout=30) as sent:
            sent.sendall(("\r\n".join(lines) + "\r\n\r\n").encode())
            return int(sent.recv(100).split()[1])


@pytest.fixture(scope="module")
def server(tmp_path_factory) -> Iterator[Server]:
    folder = tmp_path_factory.mktemp("served")
    (folder / "drive.toml").write_text(MODEL)
    with browser.studio(folder, "drive.toml") as address:
        split = urlsplit(address)
        connection = http.client.HTTPConnection(split.netloc, timeout=30)
        connection.request("GET", f"{split.path}?{split.query}")
        answer = connection.getresponse()
        assert (answer.status, answer.getheader("location")) == (303, "/")
        cookie = str(answer.getheader("set-cookie")).partition(";")[0]
        connection.close()
        yield Server(split.netloc, cookie, split.query.removeprefix("token="), folder / "studio-session")


def test_it_listens_on_this_machine_alone(server):
    assert server.host.startswith("127.0.0.1:")
    own = {str(info[4][0]) for info in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)} - {"127.0.0.1"}
    for address in own:
        with pytest.raises(ConnectionRefusedError):
            socket.create_connection((address, int(server.host.split(":")[1])), timeout=5)


def test_the_page_is_served_to_who_has_the_key(server):
    status, headers, body = server.ask("/")
    assert status == 200
    assert b"Tendon studio" in body
    assert server.token.encode() not in body
    assert "unsafe-eval" not in headers["content-security-policy"]
    script = headers["content-security-policy"].partition("script-src")[2].partition(";")[0]
    assert "unsafe" not in script
    assert b"https://" not in body.split(b"<body")[0]


PATHS = ["/", "/data/step0-joint1/spec", "/download/model?step=0", "/static/page/studio.js", "/_nicegui/x", "/docs"]


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize(
    "headers",
    [{"Cookie": ""}, {"Host": "rebound.example"}, {"Origin": "https://example.org"}, {"Sec_Fetch_Site": "cross-site"}],
)
def test_nothing_is_served_to_anybody_else(server, path, headers):
    status, _, body = server.ask(path, **headers)
    assert status == 403
    assert len(body) < 200


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({}, 101),
        ({"Origin": "http://HOST"}, 101),
        ({"Origin": "https://example.org"}, 403),
        ({"Origin": "null"}, 403),
        ({"Cookie": "a=b"}, 403),
        ({"Host": "rebound.example"}, 403),
    ],
)
def test_the_socket_of_the_page_is_the_pages_alone(server, headers, status):
    assert server.shake(**{name: value.replace("HOST", server.host) for name, value in headers.items()}) == status


def test_what_is_sent_lands_in_the_session_or_nowhere(server):
    given = server.folder / "given"
    before = sorted(p.name for p in given.iterdir())
    outside = sorted(p.name for p in server.folder.parent.iterdir())
    status, _, body = server.ask("/given?as=model&name=../../evil.toml", "POST", b"name = 3")
    assert (status, body.count(b"\n")) == (400, 1)
    assert server.ask("/given?as=somewhere&name=x.csv", "POST", b"t")[0] == 400
    assert server.ask("/given?as=fitted&name=x.csv", "POST", b"t", Origin="https://example.org")[0] == 403
    assert server.ask("/given?as=fitted&name=x.csv", "POST", b"t", Cookie="")[0] == 403
    assert server.ask("/given", "GET")[0] in (404, 405)
    assert sorted(p.name for p in given.iterdir()) == before
    assert server.ask("/given?as=fitted&name=..%2F%3Cimg%20src=x%3E.csv", "POST", b"t,q1,tau1\n")[0] == 204
    assert sorted(p.name for p in given.iterdir()) == sorted([*before, "img_src_x_.csv"])
    assert sorted(p.name for p in server.folder.parent.iterdir()) == outside
    names = [
        r["given"]["name"] for r in json.loads((server.folder / "session.json").read_text())["inputs"]["recordings"]
    ]
    assert names == ["<img src=x>.csv"]


def test_requests_that_are_no_files_are_short(server):
    assert server.ask("/", "POST", b"x" * 1_100_000)[0] == 413

    def endless() -> Iterator[bytes]:
        for _ in range(30):
            yield b"x" * 100_000

    connection = http.client.HTTPConnection(server.host, timeout=30)
    connection.request("POST", "/_nicegui_ws/socket.io/?EIO=4&transport=polling", endless(), {"Cookie": server.cookie})
    try:
        assert connection.getresponse().status >= 400
    except OSError:
        pass  # cut off while it was sending
    finally:
        connection.close()


@pytest.mark.parametrize(
    "path",
    [
        "/data/..%2F..%2Fsession/spec",
        "/data/step9-joint1/spec",
        "/download/model?step=9",
        "/download/model?step=-1",
        "/download/model",
        "/download/session.json?step=0",
        "/static/page/..%2F..%2Fsettings.py",
    ],
)
def test_there_is_nothing_else_to_be_had(server, path):
    status, _, body = server.ask(path)
    assert status in (400, 404)
    assert not any(text in body for text in (b"Traceback", b"MOST_UPLOADED", b'"schema"'))


@pytest.fixture(scope="module")
def hostile(tmp_path_factory) -> Iterator[str]:
    """The address of a studio with a model that is fitted, of files with evil names and texts."""
    folder = tmp_path_factory.mktemp("hostile")
    (folder / "drive.toml").write_text(HOSTILE)
    run = folder / EVIL
    arguments = ["simulate", str(folder / "drive.toml"), "--out", str(run), "--seconds", "10"]
    assert output.run(app, arguments) == 0
    with browser.studio(folder, "drive.toml", EVIL) as address:
        yield address


EVIL = "<img src=x onerror=document.title='evil'>.csv"
HOSTILE = f"# <script>document.title='evil'</script> {EVIL}\n{MODEL}"


def test_no_name_becomes_a_part_of_the_page(hostile):
    with browser.chromium() as chromium:
        page = chromium.new_page()
        asked: list[str] = []
        page.on("request", lambda request: asked.append(request.url))
        page.goto(hostile)
        page.get_by_text("as given, fitted").first.wait_for(timeout=120_000)
        page.get_by_text(EVIL).first.wait_for()
        assert page.title() == "Tendon studio"
        assert page.locator("img").count() == 0
        assert all(urlsplit(url).netloc == urlsplit(hostile).netloc for url in asked if not url.startswith("data:"))
        assert not any(url.endswith("/x") for url in asked)

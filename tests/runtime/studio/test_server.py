"""The server over HTTP and its socket: requests of the user's browser, of other sites and of programs."""

from __future__ import annotations

import base64
import http.client
import json
import math
import os
import socket
from collections.abc import Iterator

import pytest

from tests.runtime.studio.browser import Server
from tests.runtime.studio.waiting import PATIENCE

pytestmark = pytest.mark.xdist_group("studio")


class Asked:
    """A running studio, asked by a program that has its cookie unless other headers are given."""

    def __init__(self, server: Server) -> None:
        self.host, self.token, self.cookie = server.host, server.token, server.cookie
        self.folder = server.folder / "studio-session"

    def ask(
        self, path: str, method: str = "GET", body: object = None, **headers: str
    ) -> tuple[int, dict[str, str], bytes]:
        given = {"Cookie": self.cookie} | {name.replace("_", "-"): value for name, value in headers.items()}
        connection = http.client.HTTPConnection(self.host, timeout=PATIENCE)
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
        with socket.create_connection((host, int(port)), timeout=PATIENCE) as sent:
            sent.sendall(("\r\n".join(lines) + "\r\n\r\n").encode())
            return int(sent.recv(100).split()[1])


@pytest.fixture(scope="module")
def server(new_server: Server) -> Asked:
    return Asked(new_server)


def test_it_listens_on_this_machine_alone(server):
    assert server.host.startswith("127.0.0.1:")
    own = {str(info[4][0]) for info in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)} - {"127.0.0.1"}
    for address in own:
        with pytest.raises(ConnectionRefusedError):
            socket.create_connection((address, int(server.host.split(":")[1])), timeout=PATIENCE)


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
    log = b"t,q1,tau1\n0,0,0\n"
    assert server.ask("/given?as=fitted&name=..%2F%3Cimg%20src=x%3E.csv", "POST", log)[0] == 204
    assert sorted(p.name for p in given.iterdir()) == sorted([*before, "img_src_x_.csv"])
    assert sorted(p.name for p in server.folder.parent.iterdir()) == outside
    names = [
        r["given"]["name"] for r in json.loads((server.folder / "session.json").read_text())["inputs"]["recordings"]
    ]
    assert names == ["<img src=x>.csv"]


def test_a_file_is_checked_when_it_is_sent(server):
    """What is no recording is refused in one line and changes nothing; the columns of one are read and guessed."""
    before = (server.folder / "session.json").read_bytes()
    for content in (b"no recording\n", b"", b"\0\1"):
        status, _, body = server.ask("/given?as=fitted&name=nonsense.csv", "POST", content)
        assert (status, body.count(b"\n")) == (400, 1)
        assert body.startswith(b"nonsense.csv")
        assert str(server.folder).encode() not in body
    assert (server.folder / "session.json").read_bytes() == before
    assert not (server.folder / "given" / "nonsense.csv").exists()
    rows = [f"{5 * k};{90 * math.sin(k / 50):.4f};{math.cos(k / 50):.4f};RUN" for k in range(1000)]
    log = "\n".join(["Sent_time_ms;Axis Pos;Torque;state", *rows]) + "\n"
    assert server.ask("/given?as=fitted&name=sent.csv", "POST", log.encode())[0] == 204
    columns = json.loads((server.folder / "recordings" / "sent.csv.columns.json").read_text())
    assert [(c["name"], c["first"][:2], c["least"]) for c in columns[::3]] == [
        ("Sent_time_ms", [0.0, 5.0], 0.0),
        ("state", [], None),
    ]
    read = [json.loads(p.read_text()) for p in server.folder.glob("recordings/*/recording.json")]
    (lab,) = [r for r in read if "Sent_time_ms" in str(r["problem"])]
    assert lab["problem"].startswith("sent.csv line 1: no column t")
    assert "--" not in lab["problem"]
    assert lab["guesses"] == {"t": "Sent_time_ms [ms]", "q1": "Axis Pos [deg]", "tau1": "Torque"}


def test_requests_that_are_no_files_are_short(server):
    assert server.ask("/", "POST", b"x" * 1_100_000)[0] == 413

    def endless() -> Iterator[bytes]:
        for _ in range(30):
            yield b"x" * 100_000

    connection = http.client.HTTPConnection(server.host, timeout=PATIENCE)
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

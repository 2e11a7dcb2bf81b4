"""Who may speak to the studio: no other site, no other name, nobody without the key, and never too much at once."""

from __future__ import annotations

import asyncio
import base64
import hashlib
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.studio import guard
from runtime.studio.guard import Guard, TooLarge, policy

TOKEN, PORT = "the-key", 8123
HOST = f"127.0.0.1:{PORT}"
COOKIE = f"tendon_studio_{PORT}={TOKEN}"
PAGE = b'<html><script>let a = 1;</script><script src="/x.js"></script><script type="module">go()</script></html>'


async def inside(scope, receive, send) -> None:
    """An application that reads what it is sent and answers with a page."""
    if scope["type"] == "websocket":
        await receive()
        await send({"type": "websocket.accept"})
        return
    while (await receive()).get("more_body", False):
        pass
    kind = b"application/json" if scope["path"] == "/data" else b"text/html; charset=utf-8"
    await send({"type": "http.response.start", "status": 200, "headers": [(b"content-type", kind)]})
    await send({"type": "http.response.body", "body": PAGE[:20], "more_body": True})
    await send({"type": "http.response.body", "body": PAGE[20:]})


def ask(
    path: str = "/",
    query: str = "",
    kind: str = "http",
    method: str = "GET",
    chunks: tuple[bytes, ...] = (b"",),
    **headers: str,
) -> tuple[int | str, dict[bytes, bytes], bytes]:
    """Status (or what a socket is told), headers and body of an answer."""
    sent: list[dict[str, Any]] = []
    body = [{"type": "http.request", "body": c, "more_body": k < len(chunks) - 1} for k, c in enumerate(chunks)] or [
        {"type": "http.request"}
    ]

    async def receive() -> dict[str, Any]:
        return {"type": "websocket.connect"} if kind == "websocket" else body.pop(0)

    async def send(message) -> None:
        sent.append(dict(message))

    given = {"host": HOST} | {name.replace("_", "-"): value for name, value in headers.items()}
    scope = {
        "type": kind,
        "path": path,
        "method": method,
        "query_string": query.encode(),
        "headers": [(name.encode(), value.encode()) for name, value in given.items() if value],
    }
    asyncio.run(Guard(inside, TOKEN, PORT, ["/given"])(scope, receive, send))
    if kind == "websocket":
        return sent[0]["type"], {}, b""
    return sent[0]["status"], dict(sent[0]["headers"]), b"".join(m.get("body", b"") for m in sent[1:])


def test_the_address_is_exchanged_for_a_cookie():
    status, headers, _ = ask("/", f"token={TOKEN}")
    assert (status, headers[b"location"]) == (303, b"/")
    name, _, rest = headers[b"set-cookie"].decode().partition(";")
    assert name == COOKIE
    assert {part.strip() for part in rest.split(";")} == {"Path=/", "HttpOnly", "SameSite=Strict"}
    assert ask(cookie=name)[0] == 200


def test_two_servers_of_one_machine_do_not_take_each_others_cookies():
    assert ask(cookie=COOKIE.replace(str(PORT), "8124"))[0] == 403


@pytest.mark.parametrize("kind", ["http", "websocket"])
@pytest.mark.parametrize(
    "headers",
    [
        {"cookie": ""},
        {"cookie": COOKIE + "x"},
        {"cookie": COOKIE[:-1]},
        {"cookie": "a=b; ;;=;"},
        {"cookie": "tendon_studio_8123=ключ"},
        {"cookie": COOKIE, "host": ""},
        {"cookie": COOKIE, "host": "127.0.0.1"},
        {"cookie": COOKIE, "host": f"127.0.0.1:{PORT + 1}"},
        {"cookie": COOKIE, "host": f"rebound.example:{PORT}"},
        {"cookie": COOKIE, "host": f"{HOST}.example"},
        {"cookie": COOKIE, "origin": "https://example.org"},
        {"cookie": COOKIE, "origin": "null"},
        {"cookie": COOKIE, "origin": f"https://{HOST}"},
        {"cookie": COOKIE, "origin": f"http://127.0.0.1:{PORT + 1}"},
        {"cookie": COOKIE, "origin": f"http://{HOST}.example"},
        {"cookie": COOKIE, "sec_fetch_site": "cross-site"},
        {"cookie": COOKIE, "sec_fetch_site": "same-site"},
    ],
)
def test_whoever_is_foreign_is_refused(kind, headers):
    status, answer, body = ask(kind=kind, **headers)
    if kind == "websocket":
        assert status == "websocket.close"
    else:
        assert status == 403
        assert b"script" not in body
        assert b"default-src 'none'" in answer[b"content-security-policy"]


@pytest.mark.parametrize("kind", ["http", "websocket"])
@pytest.mark.parametrize(
    "headers",
    [
        {},
        {"origin": f"http://{HOST}"},
        {"sec_fetch_site": "same-origin"},
        {"host": f"localhost:{PORT}"},
        {"sec_fetch_site": "none"},
    ],
)
def test_the_users_own_page_is_served(kind, headers):
    assert ask(kind=kind, cookie=f"other=1; {COOKIE}", **headers)[0] in (200, "websocket.accept")


@pytest.mark.parametrize(
    ("path", "query", "more"),
    [
        ("/", "token=wrong", {}),
        ("/", "token=", {}),
        ("/", "", {}),
        ("/data", f"token={TOKEN}", {}),
        ("/", f"token={TOKEN}", {"method": "POST"}),
        ("/", f"token={TOKEN}", {"origin": "https://example.org"}),
        ("/", f"token={TOKEN}", {"sec_fetch_site": "cross-site"}),
        ("/", f"token={TOKEN}", {"host": f"rebound.example:{PORT}"}),
    ],
)
def test_no_other_way_to_a_cookie(path, query, more):
    status, headers, _ = ask(path, query, **more)
    assert status == 403
    assert b"set-cookie" not in headers


def test_a_tab_from_elsewhere_that_knows_the_token_goes_on_from_here():
    """A file that leads to the address is another site; a browser sends a strict cookie only from pages of this one."""
    more = {"sec_fetch_site": "cross-site", "sec_fetch_mode": "navigate"}
    status, headers, body = ask("/", f"token={TOKEN}", **more)
    assert (status, b"set-cookie" in headers) == (200, False)
    assert f'content="0;url=/?token={TOKEN}"'.encode() in body
    assert ask("/", "token=wrong", **more)[0] == 403
    assert ask("/", f"token={TOKEN}", origin="https://example.org", **more)[0] == 403


@given(st.text())
def test_any_token_but_the_right_one_is_wrong(text):
    assert Guard(inside, TOKEN, PORT)._is_token(text) == (text == TOKEN)


def test_requests_are_bounded_by_what_they_say_and_by_what_they_send(monkeypatch):
    monkeypatch.setattr(guard, "MOST_REQUEST", 100)
    assert ask(method="POST", cookie=COOKIE, content_length="101")[0] == 413
    assert ask(method="POST", cookie=COOKIE, content_length="100", chunks=(b"x" * 50, b"x" * 50))[0] == 200
    with pytest.raises(TooLarge):
        ask(method="POST", cookie=COOKIE, chunks=(b"x" * 60, b"x" * 60))
    # Files bound themselves, chunk by chunk.
    assert ask("/given", method="POST", cookie=COOKIE, content_length="500", chunks=(b"x" * 500,))[0] == 200


def test_a_page_runs_the_scripts_that_it_brings_and_no_other():
    _, headers, body = ask(cookie=COOKIE)
    assert body == PAGE
    rules = dict(r.strip().partition(" ")[::2] for r in headers[b"content-security-policy"].decode().split(";"))
    for text in (b"let a = 1;", b"go()"):
        assert f"'sha256-{base64.b64encode(hashlib.sha256(text).digest()).decode()}'" in rules["script-src"]
    assert "unsafe" not in rules["script-src"]
    assert rules["default-src"] == "'none'"
    assert rules["connect-src"] == rules["script-src"].split()[0] == "'self'"
    assert rules["frame-ancestors"] == rules["base-uri"] == rules["form-action"] == "'none'"
    assert not any(
        ":" in source and source not in ("data:", "blob:") for rule in rules.values() for source in rule.split()
    )
    for name in (b"x-frame-options", b"x-content-type-options", b"referrer-policy", b"cross-origin-resource-policy"):
        assert name in headers
    _, headers, body = ask("/data", cookie=COOKIE)
    assert body == PAGE
    assert "sha256" not in headers[b"content-security-policy"].decode()


def test_a_script_that_is_data_in_a_page_gives_no_leave_to_another():
    assert policy(b"<p>&lt;script&gt;evil()&lt;/script&gt;</p>").count("sha256") == 0

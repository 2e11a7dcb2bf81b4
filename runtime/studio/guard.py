"""Who may speak to the studio: the user's own browser, which was given its address, and nobody else.

The server listens on 127.0.0.1, but every page that the browser shows may send requests there, and a name of another
site may be made to mean this machine. So each request must name this server as its Host, come from its own pages where
it says where it comes from, and bring the cookie that the address with the token was exchanged for. What it sends is
bounded, and answers forbid the browser to load anything from elsewhere or to run a script that the page did not bring.

Sources: OWASP, Cross-Site Request Forgery Prevention; W3C, Content Security Policy Level 3; Fetch Metadata.
"""

from __future__ import annotations

import base64
import hashlib
import hmac
import re
import secrets
from collections.abc import Awaitable, Callable, Iterable, MutableMapping
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs

from runtime.studio.settings import MOST_REQUEST, TOKEN_BYTES

Scope = MutableMapping[str, Any]
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]
Headers = list[tuple[bytes, bytes]]

_SCRIPT = re.compile(rb"<script(?![^>]*\ssrc=)[^>]*>(.*?)</script>", re.DOTALL)
"""A script that the page brings with it."""

_HERE = '<!doctype html><title>Tendon studio</title><meta http-equiv="refresh" content="0;url=/?token={}">'
"""For a tab that brings the token from a page elsewhere, as the file in which a browser is handed it: from here it goes
on as from a page of this server, to which a browser sends its cookie."""

_ALWAYS: Headers = [
    (b"x-content-type-options", b"nosniff"),
    (b"x-frame-options", b"DENY"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-resource-policy", b"same-origin"),
]


def new_token() -> str:
    """Of the address: nobody guesses it."""
    return secrets.token_urlsafe(TOKEN_BYTES)


class Guard:
    """An application behind the checks.

    port      on which the server listens
    unbounded paths whose requests bound themselves, since they take files
    """

    def __init__(self, app: App, token: str, port: int, unbounded: Iterable[str] = ()) -> None:
        self._app = app
        self._token = token
        self._hosts = {f"{name}:{port}" for name in ("127.0.0.1", "localhost")}
        self._origins = {f"http://{host}" for host in self._hosts}
        self._cookie = f"tendon_studio_{port}"
        self._unbounded = frozenset(unbounded)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        headers = _headers(scope)
        refused = self._misled(headers) or _of_another_site(headers)
        if self._misled(headers) is None and scope["type"] == "http" and self._brings_token(scope):
            if refused is None:
                await _answer(send, 303, "", [(b"location", b"/"), self._set_cookie()])
                return
            if headers.get("sec-fetch-mode") == ["navigate"]:
                await _answer(send, 200, _HERE.format(self._token), [], b"text/html")
                return
        if refused is None and not self._known(headers):
            refused = "open the address that tendon studio has printed: it holds the key to this session"
        if refused is not None:
            await _refuse(scope, receive, send, 403, refused)
        elif scope["path"] not in self._unbounded and _size(headers) > MOST_REQUEST:
            await _refuse(scope, receive, send, 413, "the request is too large")
        elif scope["type"] == "http":
            bounded = receive if scope["path"] in self._unbounded else _Bounded(receive)
            await self._app(scope, bounded, _Forbidding(send))
        else:
            await self._app(scope, receive, send)

    def _misled(self, headers: dict[str, list[str]]) -> str | None:
        """What is wrong with where a request goes to, or says that it comes from."""
        if len(headers.get("host", [])) != 1 or headers["host"][0] not in self._hosts:
            return "this server is asked by another name than its own"
        if any(origin not in self._origins for origin in headers.get("origin", [])):
            return "the request comes from a page of another site"
        return None

    def _brings_token(self, scope: Scope) -> bool:
        given = parse_qs(scope.get("query_string", b"").decode("latin-1")).get("token", [])
        return scope["path"] == "/" and scope["method"] == "GET" and any(map(self._is_token, given))

    def _known(self, headers: dict[str, list[str]]) -> bool:
        for text in headers.get("cookie", []):
            try:
                cookie = SimpleCookie(text).get(self._cookie)
            except CookieError:
                continue
            if cookie is not None and self._is_token(cookie.value):
                return True
        return False

    def _is_token(self, text: str) -> bool:
        return hmac.compare_digest(text.encode(), self._token.encode())

    def _set_cookie(self) -> tuple[bytes, bytes]:
        return b"set-cookie", f"{self._cookie}={self._token}; Path=/; HttpOnly; SameSite=Strict".encode()


class TooLarge(ValueError):
    """A request that holds more than it may."""


class _Bounded:
    """What a request sends, as far as it may."""

    def __init__(self, receive: Receive) -> None:
        self._receive, self._size = receive, 0

    async def __call__(self) -> Message:
        message = await self._receive()
        self._size += len(message.get("body", b""))
        if self._size > MOST_REQUEST:
            raise TooLarge("the request is too large")
        return message


class _Forbidding:
    """Answers, with what they forbid the browser. A page is held back until all of it is there: its own scripts are
    known by what they say."""

    def __init__(self, send: Send) -> None:
        self._send, self._page = send, bytearray()
        self._start: Message | None = None

    async def __call__(self, message: Message) -> None:
        if message["type"] == "http.response.start":
            await self._begin(message)
        elif self._start is None:
            await self._send(message)
        else:
            self._page += message.get("body", b"")
            if not message.get("more_body", False):
                await self._send(_with(self._start, policy(bytes(self._page))))
                await self._send({**message, "body": bytes(self._page)})

    async def _begin(self, message: Message) -> None:
        kinds = [value for name, value in message["headers"] if name.lower() == b"content-type"]
        encoded = any(name.lower() == b"content-encoding" for name, _ in message["headers"])
        if any(kind.startswith(b"text/html") for kind in kinds) and not encoded:
            self._start = message
        else:
            await self._send(_with(message, policy(b"")))


def policy(page: bytes) -> str:
    """What a browser may do with an answer: run its own scripts, load and ask only here, be in no frame."""
    digests = [base64.b64encode(hashlib.sha256(text).digest()).decode() for text in _SCRIPT.findall(page)]
    known = " ".join(f"'sha256-{digest}'" for digest in dict.fromkeys(digests))
    # Elements are placed by styles of their own; no text becomes a script, not even by eval.
    return (
        f"default-src 'none'; script-src 'self' {known}; style-src 'self' 'unsafe-inline'; "
        "img-src 'self' data: blob:; font-src 'self' data:; connect-src 'self'; base-uri 'none'; form-action 'none'; "
        "frame-ancestors 'none'"
    )


def _with(start: Message, rules: str) -> Message:
    """The beginning of an answer with the headers that forbid; rules of its own, which are narrower, stay."""
    own = any(name.lower() == b"content-security-policy" for name, _ in start["headers"])
    rule = [] if own else [(b"content-security-policy", rules.encode())]
    return {**start, "headers": [*start["headers"], *_ALWAYS, *rule]}


def _of_another_site(headers: dict[str, list[str]]) -> str | None:
    """What is wrong with the page that a browser says had it ask."""
    if any(site not in ("same-origin", "none") for site in headers.get("sec-fetch-site", [])):
        return "the request comes from a page of another site; open the address in a tab of its own"
    return None


def _headers(scope: Scope) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for name, value in scope["headers"]:
        found.setdefault(name.decode("latin-1").lower(), []).append(value.decode("latin-1"))
    return found


def _size(headers: dict[str, list[str]]) -> int:
    """Of a request's body, as it says itself."""
    return max((int(text) for text in headers.get("content-length", []) if text.isdigit()), default=0)


async def _refuse(scope: Scope, receive: Receive, send: Send, status: int, why: str) -> None:
    if scope["type"] == "websocket":
        await receive()
        await send({"type": "websocket.close", "code": 1008, "reason": why})
    else:
        await _answer(send, status, f"{why}\n", [])


async def _answer(send: Send, status: int, text: str, headers: Headers, kind: bytes = b"text/plain") -> None:
    body = text.encode()
    about = [(b"content-type", kind + b"; charset=utf-8"), (b"content-length", str(len(body)).encode())]
    rule = (b"content-security-policy", b"default-src 'none'; frame-ancestors 'none'")
    await send({"type": "http.response.start", "status": status, "headers": [*about, *_ALWAYS, rule, *headers]})
    await send({"type": "http.response.body", "body": body})

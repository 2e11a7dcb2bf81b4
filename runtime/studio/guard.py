"""Access control of the studio: only the user's own browser, which was given the address, is answered.

The server listens on 127.0.0.1, but every page in the browser may send requests there, and a foreign host name may
resolve to this machine. So each request must name this server as its Host, come from its own pages where it says where
it comes from, and carry the cookie for which the token of the address was exchanged. Requests are limited in size.
Answers forbid the browser to load anything from elsewhere or to run a script that is not in the page.

Sources: OWASP, Cross-Site Request Forgery Prevention; W3C, Content Security Policy Level 3; Fetch Metadata.
"""

from __future__ import annotations

import base64
import hashlib
import hmac
import re
import secrets
from collections.abc import Iterable
from http.cookies import CookieError, SimpleCookie
from typing import TYPE_CHECKING
from urllib.parse import parse_qs

from runtime.studio.settings import MOST_REQUEST, TOKEN_BYTES

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

Headers = list[tuple[bytes, bytes]]

_SCRIPT = re.compile(rb"<script(?![^>]*\ssrc=)[^>]*>(.*?)</script>", re.DOTALL)
"""A script inside the page."""

_REDIRECT = '<!doctype html><title>Tendon studio</title><meta http-equiv="refresh" content="0;url=/?token={}">'
"""For a tab that comes from elsewhere, as from the file that opens the browser: a browser sends a strict cookie only
with requests from pages of this server, and this is one."""

_ALWAYS: Headers = [
    (b"x-content-type-options", b"nosniff"),
    (b"x-frame-options", b"DENY"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-resource-policy", b"same-origin"),
]


def new_token() -> str:
    """A random token for the address."""
    return secrets.token_urlsafe(TOKEN_BYTES)


class Guard:
    """An application behind the checks.

    port       on which the server listens
    unlimited  paths that take files and limit their requests themselves
    """

    def __init__(self, app: ASGIApp, token: str, port: int, unlimited: Iterable[str] = ()) -> None:
        self._app = app
        self._token = token
        self._hosts = {f"{name}:{port}" for name in ("127.0.0.1", "localhost")}
        self._origins = {f"http://{host}" for host in self._hosts}
        self._cookie = f"tendon_studio_{port}"
        self._unlimited = frozenset(unlimited)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        headers: dict[str, list[str]] = {}
        for name, value in scope["headers"]:
            headers.setdefault(name.decode("latin-1").lower(), []).append(value.decode("latin-1"))
        refused = self._wrong_address(headers)
        if refused is None:
            own = all(site in ("same-origin", "none") for site in headers.get("sec-fetch-site", []))
            if self._has_token(scope):
                if own:
                    cookie = f"{self._cookie}={self._token}; Path=/; HttpOnly; SameSite=Strict".encode()
                    await _answer(send, 303, "", [(b"location", b"/"), (b"set-cookie", cookie)])
                    return
                if headers.get("sec-fetch-mode") == ["navigate"]:
                    await _answer(send, 200, _REDIRECT.format(self._token), [], kind=b"text/html")
                    return
            if not own:
                refused = "the request comes from a page of another site; open the address in a tab of its own"
            elif not self._has_cookie(headers):
                refused = "open the address that tendon studio has printed: it contains the key to this session"
        if refused is not None:
            await _refuse(scope, receive, send, status=403, why=refused)
        elif scope["type"] != "http":
            await self._app(scope, receive, send)
        elif scope["path"] in self._unlimited:
            await self._app(scope, receive, _with_policy(send))
        elif any(text.isdigit() and int(text) > MOST_REQUEST for text in headers.get("content-length", [])):
            await _refuse(scope, receive, send, status=413, why="the request is too large")
        else:
            await self._app(scope, _limited(receive), _with_policy(send))

    def _wrong_address(self, headers: dict[str, list[str]]) -> str | None:
        """What is wrong with the host that a request names, or with its origin."""
        if len(headers.get("host", [])) != 1 or headers["host"][0] not in self._hosts:
            return "the request names another host than this server"
        if any(origin not in self._origins for origin in headers.get("origin", [])):
            return "the request comes from a page of another site"
        return None

    def _has_token(self, scope: Scope) -> bool:
        if scope["type"] != "http" or scope["path"] != "/" or scope["method"] != "GET":
            return False
        given = parse_qs(scope.get("query_string", b"").decode("latin-1")).get("token", [])
        return any(map(self._is_token, given))

    def _has_cookie(self, headers: dict[str, list[str]]) -> bool:
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


class TooLarge(ValueError):
    """A request that is larger than it may be."""


def _limited(receive: Receive) -> Receive:
    """Raises TooLarge once a request has sent more than it may."""
    size = 0

    async def bounded() -> Message:
        nonlocal size
        message = await receive()
        size += len(message.get("body", b""))
        if size > MOST_REQUEST:
            raise TooLarge("the request is too large")
        return message

    return bounded


def _with_policy(send: Send) -> Send:
    """Answers with the headers that restrict the browser. A page is held back until it is complete: the policy lists
    the hashes of its scripts."""
    start: Message = {}
    page = bytearray()

    async def restricted(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = {name.lower(): value for name, value in message["headers"]}
            is_page = headers.get(b"content-type", b"").startswith(b"text/html") and b"content-encoding" not in headers
            if is_page:
                start.update(message)
            else:
                await send(_restricted(message, b""))
        elif not start:
            await send(message)
        else:
            page.extend(message.get("body", b""))
            if not message.get("more_body", False):
                await send(_restricted(start, bytes(page)))
                await send({**message, "body": bytes(page)})

    return restricted


def _restricted(start: Message, page: bytes) -> Message:
    """The beginning of an answer with its policy; one that it has already is narrower and stays."""
    has_own = any(name.lower() == b"content-security-policy" for name, _ in start["headers"])
    rule = [] if has_own else [(b"content-security-policy", policy(page).encode())]
    return {**start, "headers": [*start["headers"], *_ALWAYS, *rule]}


def policy(page: bytes) -> str:
    """What a browser may do with an answer: run the page's own scripts, load and ask only here, be in no frame."""
    digests = [base64.b64encode(hashlib.sha256(text).digest()).decode() for text in _SCRIPT.findall(page)]
    known = " ".join(f"'sha256-{digest}'" for digest in dict.fromkeys(digests))
    # Styles may be inline: elements have their own. No text becomes a script, not even by eval.
    return (
        f"default-src 'none'; script-src 'self' {known}; style-src 'self' 'unsafe-inline'; "
        "img-src 'self' data: blob:; font-src 'self' data:; connect-src 'self'; base-uri 'none'; form-action 'none'; "
        "frame-ancestors 'none'"
    )


async def _refuse(scope: Scope, receive: Receive, send: Send, *, status: int, why: str) -> None:
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

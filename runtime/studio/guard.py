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
from collections.abc import Iterable

from starlette.datastructures import Headers, MutableHeaders, QueryParams
from starlette.requests import cookie_parser
from starlette.responses import HTMLResponse, PlainTextResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from runtime.studio.settings import MOST_REQUEST

_SCRIPT = re.compile(rb"<script(?![^>]*\ssrc=)[^>]*>(.*?)</script>", re.DOTALL)
"""A script inside the page."""

_REDIRECT = '<!doctype html><title>Tendon studio</title><meta http-equiv="refresh" content="0;url=/?token={}">'
"""For a tab that comes from elsewhere, as from the file that opens the browser: a browser sends a strict cookie only
with requests from pages of this server, and this is one."""

_ALWAYS = {
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
}
_OWN = _ALWAYS | {"content-security-policy": "default-src 'none'; frame-ancestors 'none'"}
"""Headers of the guard's own answers."""


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
        headers = Headers(scope=scope)
        answer = self._own_answer(scope, headers)
        if answer is None and scope["type"] == "http" and scope["path"] not in self._unlimited:
            if any(text.isdigit() and int(text) > MOST_REQUEST for text in headers.getlist("content-length")):
                answer = PlainTextResponse("the request is too large\n", 413, _OWN)
            receive = _limited(receive)
        if answer is None:
            await self._app(scope, receive, _with_policy(send) if scope["type"] == "http" else send)
        elif scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.close", "code": 1008, "reason": bytes(answer.body).decode().strip()})
        else:
            await answer(scope, receive, send)

    def _own_answer(self, scope: Scope, headers: Headers) -> Response | None:
        """The answer to a request that the application must not see: the cookie for the token, or why it is refused."""
        own = all(site in ("same-origin", "none") for site in headers.getlist("sec-fetch-site"))
        token = scope["type"] == "http" and (scope["path"], scope["method"]) == ("/", "GET")
        token = token and any(map(self._is_token, QueryParams(scope.get("query_string", b"")).getlist("token")))
        cookies = [cookie_parser(text).get(self._cookie, "") for text in headers.getlist("cookie")]
        if len(headers.getlist("host")) != 1 or headers["host"] not in self._hosts:
            why = "the request names another host than this server"
        elif any(origin not in self._origins for origin in headers.getlist("origin")):
            why = "the request comes from a page of another site"
        elif token and own:
            cookie = f"{self._cookie}={self._token}; Path=/; HttpOnly; SameSite=Strict"
            return PlainTextResponse("", 303, _OWN | {"location": "/", "set-cookie": cookie})
        elif token and headers.getlist("sec-fetch-mode") == ["navigate"]:
            return HTMLResponse(_REDIRECT.format(self._token), 200, _OWN)
        elif not own:
            why = "the request comes from a page of another site; open the address in a tab of its own"
        elif not any(map(self._is_token, cookies)):
            why = "open the address that tendon studio has printed: it contains the key to this session"
        else:
            return None
        return PlainTextResponse(f"{why}\n", 403, _OWN)

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
            headers = Headers(raw=message["headers"])
            is_page = headers.get("content-type", "").startswith("text/html") and "content-encoding" not in headers
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
    headers = MutableHeaders(raw=[*start["headers"]])
    headers.update(_ALWAYS)
    headers.setdefault("content-security-policy", policy(page))
    return {**start, "headers": headers.raw}


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

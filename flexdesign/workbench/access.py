"""Who may see the page: on this machine whoever is on it, from elsewhere whoever has the token."""

from __future__ import annotations

import ipaddress
import secrets
from http.cookies import SimpleCookie
from urllib.parse import parse_qs, urlsplit

from starlette.types import ASGIApp, Message, Receive, Scope, Send

COOKIE = "flexdesign_token"


def is_local(host: str) -> bool:
    """Tell whether an address is of this machine alone.

    >>> is_local("127.0.0.1"), is_local("localhost"), is_local("0.0.0.0")
    (True, True, False)
    """
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def new_token() -> str:
    """Return a token that nobody guesses."""
    return secrets.token_urlsafe(24)


class Guard:
    """Lets requests in that may come in, of pages as of sockets.

    Without a token only names of this machine are answered, so that no page of another site reaches it by a name of its
    own (DNS rebinding). A request of a page of another site is refused in any case.

    Parameters
    ----------
    app
        What answers.
    token
        What a request from elsewhere must have, in its address or its cookie; empty if none is needed.
    """

    def __init__(self, app: ASGIApp, token: str = "") -> None:
        self.app, self.token = app, token

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, or refuse."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        headers = {name.decode("latin-1").lower(): value.decode("latin-1") for name, value in scope["headers"]}
        given = parse_qs(scope.get("query_string", b"").decode("latin-1")).get("token", [""])[0]
        if reason := self._refusal(headers, given):
            await _refuse(scope, send, reason)
            return

        async def with_cookie(message: Message) -> None:
            if message["type"] == "http.response.start" and self.token and given:
                cookie = f"{COOKIE}={self.token}; HttpOnly; SameSite=Strict; Path=/"
                message["headers"] = [*message.get("headers", []), (b"set-cookie", cookie.encode())]
            await send(message)

        await self.app(scope, receive, with_cookie)

    def _refusal(self, headers: dict[str, str], given: str) -> str:
        host = urlsplit(f"//{headers.get('host', '')}").hostname or ""
        origin = headers.get("origin", "")
        if origin and urlsplit(origin).netloc != headers.get("host", ""):
            return "The request comes from a page of another site."
        if not self.token:
            return "" if is_local(host) else "The workbench answers on 127.0.0.1 and localhost alone."
        cookie = SimpleCookie(headers.get("cookie", "")).get(COOKIE)
        has = given or (cookie.value if cookie else "")
        if secrets.compare_digest(has.encode(), self.token.encode()):
            return ""
        return "The token is missing or wrong; open the address that `flexdesign workbench` printed."


async def _refuse(scope: Scope, send: Send, reason: str) -> None:
    if scope["type"] == "websocket":
        await send({"type": "websocket.close", "code": 1008, "reason": reason})
        return
    text = [(b"content-type", b"text/plain; charset=utf-8")]
    await send({"type": "http.response.start", "status": 403, "headers": text})
    await send({"type": "http.response.body", "body": reason.encode()})

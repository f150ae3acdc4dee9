"""Who may speak to a page that is served here: whoever knows the token, by the right name.

A page of the web can send requests to 127.0.0.1, and by a name of its own that leads there it may
read the answers (DNS rebinding). Neither knows the token, which is part of every address; cookies
would not do, for they are shared by all servers of a computer. No answer allows other origins.
"""

import secrets
from collections.abc import Collection

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

OPEN = "/report/"
"""Below this every page has a secret of its own, so that a report does not know the token."""

_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
    "img-src 'self' data:; frame-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)


class Guard:
    """Refuses what comes by another name, from another page or without the token.

    Parameters
    ----------
    app : ASGIApp
        Whose addresses all begin with ``/TOKEN/`` or with `OPEN`.
    token : str
    hosts : collection of str, optional
        Names with port under which the page may be asked for; any if not given.
    command : str
        What printed the address.
    """

    def __init__(
        self,
        app: ASGIApp,
        *,
        token: str,
        hosts: Collection[str] | None,
        command: str = "backsight open",
    ) -> None:
        self.app, self.token, self.hosts, self.command = app, token, hosts, command

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, see ASGI."""
        if scope["type"] != "http":
            return
        headers = Headers(scope=scope)
        host, origin = headers.get("host", ""), headers.get("origin")
        if self.hosts is not None and host not in self.hosts:
            refusal = "this name does not lead here"
        elif origin not in (None, "null", f"{scope.get('scheme', 'http')}://{host}") or (
            origin == "null" and scope["method"] not in ("GET", "HEAD")
        ):
            refusal = "another page must not ask"
        elif not self._knows(scope["path"]):
            refusal = f"open the address that {self.command} has printed"
        else:
            await self.app(scope, receive, _protected(send, scope["path"]))
            return
        await PlainTextResponse(refusal, 403)(scope, receive, _protected(send, ""))

    def _knows(self, path: str) -> bool:
        first = path.split("/")[1] if "/" in path else ""
        same = secrets.compare_digest(first.encode(), self.token.encode())
        return same or path.startswith(OPEN)


def _protected(send: Send, path: str) -> Send:
    """Add the headers that keep other pages out; a report brings a policy of its own."""

    async def sending(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            headers["Cache-Control"] = "no-store"
            headers["Referrer-Policy"] = "no-referrer"
            headers["X-Content-Type-Options"] = "nosniff"
            headers["Cross-Origin-Resource-Policy"] = "same-origin"
            report = path.startswith(OPEN)
            headers["Content-Security-Policy"] = "frame-ancestors 'self'" if report else _POLICY
        await send(message)

    return sending

"""The addresses of the dashboard."""

import asyncio
import json
from collections.abc import AsyncIterator, Collection
from importlib.resources import files
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import (
    FileResponse,
    JSONResponse,
    PlainTextResponse,
    Response,
    StreamingResponse,
)
from starlette.routing import Mount, Route

from backsight.errors import BacksightError, DataError
from backsight.live.dashboard._board import Board
from backsight.web import OPEN, Guard

MOST_BROWSERS = 200
"""Pages that are kept up to date at once."""

MOST_ASKED = 10_000
"""Bytes of a request."""

_TYPES = {".html": "text/html", ".css": "text/css", ".js": "text/javascript"}
_LOOK = 0.025
"""Seconds between two looks for a new frame."""


def dashboard_application(board: Board, *, token: str, hosts: Collection[str] | None) -> Starlette:
    """Return the web application.

    Parameters
    ----------
    board : Board
        What it shows.
    token : str
        First part of every address.
    hosts : collection of str, optional
        Names with port under which it may be asked for.
    """
    shown = _Shown(board)
    routes = [
        Route("/", _resource),
        Route("/page/{name}", _resource),
        Route("/state", shown.state),
        Route("/history", shown.history),
        Route("/frames", shown.frames),
        Route("/acknowledge", shown.acknowledge, methods=["POST"]),
        Route("/save", shown.save, methods=["POST"]),
    ]
    return Starlette(
        routes=[Mount(f"/{token}", routes=routes), Route(OPEN + "{key}", shown.report)],
        middleware=[Middleware(Guard, token=token, hosts=hosts, command="backsight live")],
        exception_handlers={BacksightError: _refused},
    )


async def _refused(_: Request, error: Exception) -> Response:
    return JSONResponse({"error": str(error)}, 422)


def _resource(request: Request) -> Response:
    name = request.path_params.get("name", "live.html")
    kind = _TYPES.get(Path(name).suffix)
    for place in (
        files("backsight.live.dashboard").joinpath("page", name),
        files("backsight.web").joinpath("assets", name),
    ):
        if kind is not None and "/" not in name and place.is_file():
            return Response(place.read_bytes(), media_type=kind)
    return PlainTextResponse("there is no such page", 404)


class _Shown:
    """Answers to what the page asks."""

    def __init__(self, board: Board) -> None:
        self.board, self.browsers = board, 0

    def state(self, _: Request) -> Response:
        """What does not change."""
        return JSONResponse(self.board.described())

    def history(self, request: Request) -> Response:
        """Curves over the last seconds."""
        try:
            span = min(max(float(request.query_params.get("span", "60")), 1.0), 4e6)
        except ValueError:
            raise DataError("span: give a number of seconds") from None
        if span != span:
            raise DataError("span: give a number of seconds")
        return JSONResponse(self.board.history.over(span))

    async def frames(self, request: Request) -> Response:
        """Frames as they are made, as server-sent events."""
        if self.browsers >= MOST_BROWSERS:
            return PlainTextResponse("too many pages are open", 503)
        return StreamingResponse(self._stream(request), media_type="text/event-stream")

    async def _stream(self, request: Request) -> AsyncIterator[bytes]:
        self.browsers += 1
        seen = max(self.board.newest - 1, 0)
        try:
            while not await request.is_disconnected():
                frames, missed = self.board.after(seen)
                if missed:
                    yield b"event: missed\ndata: 1\n\n"
                for number, content in frames:
                    seen = number
                    yield b"data: " + content + b"\n\n"
                if self.board.ended:  # else the server would have to break the connection
                    yield b"event: ended\ndata: 1\n\n"
                    return
                await asyncio.sleep(_LOOK)
        finally:
            self.browsers -= 1

    async def acknowledge(self, request: Request) -> Response:
        """Somebody has seen an alarm."""
        name = (await _asked(request)).get("name")
        alarms = self.board.session.alarms
        if alarms is None or not isinstance(name, str) or not alarms.acknowledge(name):
            raise DataError("there is no alarm of this name")
        return JSONResponse({})

    async def save(self, request: Request) -> Response:
        """Save the last minutes, and estimate them."""
        minutes = (await _asked(request)).get("minutes")
        if isinstance(minutes, bool) or not isinstance(minutes, int | float):
            raise DataError("minutes: give a number")
        saved = await run_in_threadpool(self.board.recent.save, float(minutes))
        return JSONResponse(saved.described())

    def report(self, request: Request) -> Response:
        """The report of a recording that was saved."""
        page = self.board.recent.page(request.path_params["key"])
        if page is None or not page.exists():
            return PlainTextResponse("there is no such report", 404)
        return FileResponse(page, media_type="text/html")


async def _asked(request: Request) -> dict[str, Any]:
    """The object in the body of a request."""
    body = b""
    async for chunk in request.stream():
        body += chunk
        if len(body) > MOST_ASKED:
            raise DataError("the request is too long")
    try:
        found = json.loads(body)
    except (ValueError, RecursionError):
        raise DataError("the request is no JSON") from None
    if not isinstance(found, dict):
        raise DataError("the request is no object")
    return found

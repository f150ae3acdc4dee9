"""The addresses of the workbench."""

import json
import shutil
from collections.abc import Awaitable, Callable, Collection
from importlib.resources import files
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import Mount, Route

from backsight.data.listing import FileColumns
from backsight.errors import BacksightError, DataError, ProblemError
from backsight.problem.reading.checking import validated
from backsight.web.guard import OPEN, Guard
from backsight.workbench._bench import FILES, Workbench
from backsight.workbench._choices import METHODS, Choices
from backsight.workbench._gallery import GALLERY
from backsight.workbench._suggesting import completed, proper_names, suggested
from backsight.workbench._writing import problem_text

MOST_ASKED = 1_000_000
"""Bytes of a request that is no recording."""

MOST_SENT = 4 * 2**30
"""Bytes of a recording that is sent; a larger one is named at the start, where nothing is sent."""

_TYPES = {".html": "text/html", ".css": "text/css", ".js": "text/javascript"}

Answer = Callable[[Request], Awaitable[Response]]


def application(bench: Workbench, *, token: str, hosts: Collection[str]) -> Starlette:
    """Return the web application.

    Parameters
    ----------
    bench : Workbench
        What it works on.
    token : str
        First part of every address.
    hosts : collection of str
        Names with port under which it may be asked for.
    """
    asked = _Asked(bench)
    routes = [
        Route("/", _resource),
        Route("/page/{name}", _resource),
        Route("/state", asked.state),
        Route("/recording", asked.recording, methods=["PUT"]),
        Route("/suggest", asked.suggest, methods=["POST"]),
        Route("/check", asked.check, methods=["POST"]),
        Route("/runs", asked.runs, methods=["GET", "POST"]),
        Route("/compare", asked.compare, methods=["POST"]),
        Route("/runs/{number:int}/stop", asked.stop, methods=["POST"]),
        Route("/runs/{number:int}/{name}", asked.saved),
    ]
    return Starlette(
        routes=[Mount(f"/{token}", routes=routes), Route(OPEN + "{key}", asked.report)],
        middleware=[Middleware(Guard, token=token, hosts=hosts)],
        exception_handlers={BacksightError: _refused},
    )


async def _refused(_: Request, error: Exception) -> Response:
    return JSONResponse({"error": str(error)}, 422)


def _resource(request: Request) -> Response:
    name = request.path_params.get("name", "page.html")
    place = files("backsight.workbench").joinpath("page", name)
    kind = _TYPES.get(Path(name).suffix)
    if kind is None or "/" in name or not place.is_file():
        return PlainTextResponse("there is no such page", 404)
    return Response(place.read_bytes(), media_type=kind)


class _Asked:
    """Answers to what the page asks."""

    def __init__(self, bench: Workbench) -> None:
        self.bench = bench

    def state(self, _: Request) -> Response:
        """Everything that the page needs at its start."""
        machines = {
            key: {
                "title": m.title,
                "about": m.about,
                "inputs": [vars(s) for s in m.inputs],
                "outputs": [vars(s) for s in m.outputs],
                "meanings": {q.name: q.meaning for q in (*m.constants, *m.loads)},
                "loads": [q.name for q in m.loads],
            }
            for key, m in GALLERY.items()
        }
        found = self.bench.found
        names = proper_names(found) if found else {}
        return JSONResponse(
            {
                "recording": self.bench.listed(),
                "names": names,
                "machines": machines,
                "methods": list(METHODS),
                "text": self.bench.text,
                "runs": [run.described() for run in self.bench.runs],
            }
        )

    async def recording(self, request: Request) -> Response:
        """Take a recording that is dropped on the page."""
        place = self.bench.receive(request.query_params.get("name", ""))
        part = place.with_name(f".{place.name}.part")
        room = min(MOST_SENT, shutil.disk_usage(self.bench.folder).free // 2)
        try:
            sent = 0
            with part.open("xb") as file:
                async for chunk in request.stream():
                    sent += len(chunk)
                    if sent > room:
                        raise DataError(
                            "the recording is too large to be sent; begin with "
                            "`backsight open FILE`, which reads it where it is"
                        )
                    file.write(chunk)
            part.rename(place)
        finally:
            part.unlink(missing_ok=True)
        try:
            await run_in_threadpool(self.bench.accept, place)
        except BacksightError:
            place.unlink()
            raise
        return await run_in_threadpool(self.state, request)

    async def suggest(self, request: Request) -> Response:
        """Choices to begin with for a machine, or for what was changed."""
        given = await _json(request)
        if set(given) == {"machine"}:
            choices = await run_in_threadpool(suggested, str(given["machine"]), self._found())
        else:
            chosen = validated(Choices, given)
            choices = await run_in_threadpool(completed, chosen, self._found())
        return JSONResponse(choices.model_dump())

    async def check(self, request: Request) -> Response:
        """The problem file of the choices (or as it was edited), and what is wrong in it."""
        given = await _json(request)
        text, error, model = given.get("text"), "", ""
        try:
            if text is None:
                chosen, bench = validated(Choices, given), self.bench
                text = problem_text(chosen, self._found(), bench.path, firsts=bench.firsts)
            model = await run_in_threadpool(self.bench.check, str(text))
        except BacksightError as fault:
            error = str(fault)
        return JSONResponse({"text": text or "", "error": error, "model": model})

    async def runs(self, request: Request) -> Response:
        """How far the runs are; with a problem file, another one."""
        if request.method == "POST":
            text = (await _json(request)).get("text")
            if not isinstance(text, str):
                raise ProblemError("text: the problem file is missing")
            self.bench.start(text)
        return JSONResponse([run.described() for run in self.bench.runs])

    def stop(self, request: Request) -> Response:
        """End a run."""
        self.bench.run(request.path_params["number"]).stop()
        return JSONResponse({})

    async def compare(self, request: Request) -> Response:
        """Several runs on one page."""
        numbers = (await _json(request)).get("runs")
        if not isinstance(numbers, list) or not all(isinstance(n, int) for n in numbers):
            raise ProblemError("runs: give the numbers of the runs to compare")
        page = await run_in_threadpool(self.bench.compare, numbers)
        return JSONResponse({"report": page})

    def saved(self, request: Request) -> Response:
        """A file of a run, to be kept."""
        run, name = self.bench.run(request.path_params["number"]), request.path_params["name"]
        place = run.problem if name == "problem.toml" else run.out / name
        if name not in (*FILES, "problem.toml") or not place.exists():
            return PlainTextResponse("there is no such file", 404)
        saved = f"{run.out.name}-{name}" if name != "problem.toml" else place.name
        return FileResponse(place, filename=saved)

    def report(self, request: Request) -> Response:
        """A report, by its own secret."""
        page = self.bench.report(request.path_params["key"])
        if page is None or not page.exists():
            return PlainTextResponse("there is no such report", 404)
        return FileResponse(page, media_type="text/html")

    def _found(self) -> FileColumns:
        if self.bench.found is None:
            raise ProblemError("there is no recording yet: drop a file on the page")
        return self.bench.found


async def _json(request: Request) -> dict[str, Any]:
    """The table that a request brings; a large one is refused before it is read."""
    body = b""
    async for chunk in request.stream():
        body += chunk
        if len(body) > MOST_ASKED:
            raise ProblemError(f"more than {MOST_ASKED} bytes; the limit of a problem on the page")
    try:
        given = json.loads(body)
    except (ValueError, RecursionError):
        given = None
    if not isinstance(given, dict):
        raise ProblemError("the page has sent what cannot be read; load it again")
    return given

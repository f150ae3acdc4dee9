"""The command that estimates while samples come."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from backsight.cli._console import say, tell, told


def live(
    problem: Annotated[Path, typer.Argument(help="Problem file (TOML) with [source.NAME].")],
    speed: Annotated[
        float | None,
        typer.Option(min=0, help="Of a replay, by how much faster; 0: as fast as possible."),
    ] = None,
    dashboard: Annotated[
        bool, typer.Option("--dashboard", help="Serve a dashboard if the file has none.")
    ] = False,
) -> None:
    """Estimate while samples come: from sources on the wire, or a recording that is replayed.

    Ctrl-C ends it; what was measured until then is estimated and stored.
    A file without a source replays its recording. The exit code is 0 if it
    was ended or the sources have, 1 if there was no room on the disk for
    some of the results, and 2 if it could not begin.
    """
    with told():
        from backsight.live import run_live

        show = say if sys.stderr.isatty() else None
        status = run_live(
            problem, tell=tell, show=show, speed=speed, dashboard=dashboard, survive=True
        )
        say(status.summary())
    if status.given_up:
        raise typer.Exit(1)

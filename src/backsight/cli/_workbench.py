"""The command that opens the workbench."""

from pathlib import Path
from typing import Annotated

import typer

from backsight.cli._console import say, told


def open_page(
    file: Annotated[
        Path | None, typer.Argument(help="Recording or problem file to begin with.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Folder that keeps everything [a temporary one]."),
    ] = None,
    port: Annotated[int, typer.Option(min=0, max=65535, help="0: one that is free.")] = 0,
    browser: Annotated[bool, typer.Option(help="Open a browser.")] = True,
) -> None:
    """Open the workbench in a browser: from a recording to a report without Python.

    The page is for this computer only; the printed address is its key.
    """
    with told():
        from backsight.workbench import open_workbench

        open_workbench(file, out=out, port=port, browser=browser, tell=say)

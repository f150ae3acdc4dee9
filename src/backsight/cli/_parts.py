"""The command ``run`` for recordings that need not fit into memory."""

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from backsight.cli._console import bar, say, width

if TYPE_CHECKING:
    from backsight.problem.problem import Problem


def run_parts(read: "Problem", out: Path, env: Sequence[str]) -> None:
    """Run part by part; a run that was interrupted goes on when it is started again."""
    from backsight.problem.in_parts import (
        PARTS,
        failure_in_parts,
        lines_of_parts,
        run_in_parts,
    )

    try:
        with bar() as advance:
            found = run_in_parts(read, out, progress=advance, env=env)
    except KeyboardInterrupt as interrupt:
        interrupt.__notes__ = [
            "whole parts are kept: start again with the same folder to go on",
        ]
        raise
    say(f"{read.title}\n")
    for line in lines_of_parts(found):
        say(textwrap.fill(line, width(), subsequent_indent="  "))
    say(f"\nEstimates: {out / PARTS}")
    if any(failure_in_parts(rows) for rows in found.values()):
        raise typer.Exit(1)

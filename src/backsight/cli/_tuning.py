"""The command that tunes a problem."""

from pathlib import Path
from typing import Annotated

import typer

from backsight.cli._console import bar, say, told
from backsight.cli._options import Env, Force, Outside


def tune(
    problem: Annotated[Path, typer.Argument(help="Problem file (TOML).")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Problem file with what was found.")],
    estimator: Annotated[
        str | None, typer.Option("--estimator", "-e", help="Its name in the file.")
    ] = None,
    page: Annotated[Path | None, typer.Option(help="Page with before and after (HTML).")] = None,
    force: Force = False,
    outside: Outside = None,
    env: Env = None,
) -> None:
    """Find noise, prior, parameters and settings from the recording alone.

    The table [tune] of the file says what is free; without it all noise
    is, of sparse forces their weight. The new file is the old one,
    comments included, with other values. The exit code is 0 if all was
    found, 1 if something could not be (the lines with "!"), and 2 if
    something is at fault and nothing is written.
    """
    with told():
        from backsight.problem import load, tune_problem

        read = load(problem)
        with bar() as advance:
            found = tune_problem(
                read,
                out,
                estimator=estimator,
                page=page,
                force=force,
                outside=outside or (),
                env=env or (),
                progress=lambda share: advance("passes", share),
            )
        say(f"{read.title}\n\n{found.tuned}\n")
        say(f"Tuned by: {found.by}\nProblem: {out}" + (f"\nPage: {page}" if page else ""))
    if found.tuned.doubts:
        raise typer.Exit(1)

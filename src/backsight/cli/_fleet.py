"""The command that runs fleets."""

from pathlib import Path
from typing import Annotated

import typer

from backsight.cli._console import bar, say, tell, told, warn
from backsight.cli._options import Env, Out, Outside

MOST_REASONS = 5
"""Failures that are shown; the table has all of them."""


def fleet(
    file: Annotated[Path, typer.Argument(help="Fleet file (TOML).")],
    out: Out,
    workers: Annotated[
        int | None,
        typer.Option(min=0, help="Processes on this computer [one per core]; 0: this one alone."),
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(help="Scheduler of dask.distributed that is there, tcp://...")
    ] = None,
    outside: Outside = None,
    env: Env = None,
) -> None:
    """Run a problem over many recordings, with many settings.

    What is in the folder already is not done again: a run that was
    interrupted goes on when it is started again. The folder gets a page
    (fleet.html) and the table as CSV and Parquet. The exit code is 0 if
    all went well, 1 if a recording failed (its row says why), and 2 if
    the fleet, the folder or the workers are at fault; what is finished
    stays then.
    """
    with told():
        from backsight.fleet import load_fleet, read_rows, run_fleet, write_table
        from backsight.fleet.page import write_fleet_page

        read = load_fleet(file, env=env or ())
        try:
            with bar() as advance:
                run = run_fleet(
                    read,
                    out,
                    workers=workers,
                    scheduler=scheduler,
                    outside=outside or (),
                    env=env or (),
                    progress=lambda done, all_: advance(read.title, done / all_),
                    tell=warn,
                )
        except KeyboardInterrupt as interrupt:
            interrupt.__notes__ = [
                "what is finished is kept: start again with the same folder to go on",
            ]
            raise
        rows = read_rows(out)
        write_table(rows, out / "rows.csv")
        parquet = _parquet(rows, out)
        page = write_fleet_page(out, rows)
        failed = rows[rows["failure"] != ""]
        done = f"{run.items - run.before} done" + (f", {run.before} before" if run.before else "")
        say(
            f"{read.title}: {_counted(len(read.recordings), 'recording')}, "
            f"{_counted(len(read.settings), 'setting')}; "
            f"{done}; {len(failed)} of {len(rows)} rows failed"
        )
        for _, row in failed.head(MOST_REASONS).iterrows():
            tell(f"{row['recording']}: {row['failure']}")
        if len(failed) > MOST_REASONS:
            tell(f"and {len(failed) - MOST_REASONS} more, see the table")
        say(f"\nPage:  {page}\nTable: {out / 'rows.csv'}{parquet}")
    if len(failed):
        raise typer.Exit(1)


def _counted(number: int, what: str) -> str:
    return f"{number} {what}{'s' * (number != 1)}"


def _parquet(rows: object, out: Path) -> str:
    """Write the table as Parquet, too, where its library is installed."""
    import importlib.util

    from backsight.fleet import write_table

    if importlib.util.find_spec("pyarrow") is None:
        return ""
    return f", {write_table(rows, out / 'rows.parquet').name}"  # pyright: ignore[reportArgumentType]

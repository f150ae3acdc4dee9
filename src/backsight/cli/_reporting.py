"""The command that draws reports of what was run before."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from backsight.cli._console import bar, say, told, warn
from backsight.cli._options import Env, Outside
from backsight.errors import ProblemError


def report_again(
    estimates: Annotated[
        list[Path], typer.Argument(help="estimates.nc of one or several runs, or a fleet's folder.")
    ],
    out: Annotated[Path, typer.Option("--out", "-o", help="The page to write.")],
    item: Annotated[
        str | None, typer.Option(help="Of a fleet: the item, as its table names it.")
    ] = None,
    outside: Outside = None,
    env: Env = None,
    shared: Annotated[
        bool,
        typer.Option(
            "--shared",
            help="Put the program that draws, 1.5 MB, beside the page: a folder shares it.",
        ),
    ] = False,
) -> None:
    """Draw the report again from results, of several runs side by side.

    Of a fleet, which keeps a row of every recording, one recording is run
    again with its setting: --item says which.
    """
    with told():
        page = (
            _of_results(estimates, out, shared=shared)
            if item is None
            else _of_item(estimates, item, out, outside or (), env or ())
        )
        say(f"Report: {page}")


def _of_results(estimates: Sequence[Path], out: Path, *, shared: bool) -> Path:
    from backsight.problem.results_file import read_estimates
    from backsight.report import report

    for folder in estimates:
        if folder.is_dir():
            raise ProblemError(f"'{folder}' is a folder; of a fleet, say which item: --item ITEM")
    read = {file: read_estimates(file) for file in estimates}
    runs = _names_of_runs(list(read))
    results = {
        name if len(read) == 1 else f"{runs[file]}: {name}": result
        for file, found in read.items()
        for name, result in found.results.items()
    }
    first = next(iter(read.values()))
    title = " | ".join(dict.fromkeys(found.title for found in read.values() if found.title))
    problem = first.problem if len(read) == 1 else None
    return report(
        results,
        out,
        title=title or None,
        problem=problem,
        library="beside" if shared else "inside",
    )


def _names_of_runs(files: Sequence[Path]) -> dict[Path, str]:
    """Name runs by their folders; by their paths where folders have the same name."""
    names = {file: file.absolute().parent.name or file.stem for file in files}
    return names if len(set(names.values())) == len(files) else {f: str(f) for f in files}


def _of_item(
    stores: Sequence[Path], item: str, out: Path, outside: Sequence[str], env: Sequence[str]
) -> Path:
    import tempfile

    from backsight.fleet import problem_of_item
    from backsight.output import write_whole
    from backsight.problem import run_problem
    from backsight.problem.running import PAGE

    if len(stores) > 1:
        raise ProblemError("--item is of one fleet; give its folder alone")
    problem = problem_of_item(stores[0], item)
    with tempfile.TemporaryDirectory() as folder:
        with bar() as advance:
            run_problem(
                problem,
                Path(folder) / "run",
                progress=lambda name, k, n: advance(name, k / n),
                tell=warn,
                outside=outside,
                env=env,
            )
        return write_whole(out, (Path(folder) / "run" / PAGE).read_bytes())

"""Commands that look at a recording before there is a problem."""

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, cast

import typer

from backsight.cli._console import say, told, width

if TYPE_CHECKING:
    from backsight.data.listing import FileColumns

Form = Annotated[
    str | None, typer.Option("--format", help="Kind of the file whatever it is called.")
]
Delimiter = Annotated[str | None, typer.Option(help="Of texts: what separates cells.")]
Decimal = Annotated[str | None, typer.Option(help="Of texts: the decimal sign, . or ,")]
Header = Annotated[int | None, typer.Option(help="Of texts: number of the line with the names.")]
AxisOfTime = Annotated[int | None, typer.Option(help="Of matrices: axis of time, 0 or 1.")]


def show_columns(
    file: Annotated[Path, typer.Argument(help="Recording of any kind that is read.")],
    form: Form = None,
    delimiter: Delimiter = None,
    decimal: Decimal = None,
    header: Header = None,
    axis: AxisOfTime = None,
) -> None:
    """List the columns of a recording: units, rates, ranges, and what looks wrong.

    Of the clock it says the period and gaps, of signals codes for "not
    measured", clipping, dropouts, and samples that are missing.
    """
    with told():
        say(_listed(file, form, delimiter, decimal, header, axis).table(width()))


def write_problem(
    file: Annotated[Path, typer.Argument(help="Recording of any kind that is read.")],
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Problem file to write [that of the recording, .toml]."),
    ] = None,
    form: Form = None,
    delimiter: Delimiter = None,
    decimal: Decimal = None,
    header: Header = None,
    axis: AxisOfTime = None,
) -> None:
    """Write a problem file for a recording to start from.

    It has the columns with their units and a model of no mechanics, which
    smooths them, until yours takes its place; comments say what to fill in.
    No file is overwritten.
    """
    with told():
        from backsight.problem.starting import write_start

        found = _listed(file, form, delimiter, decimal, header, axis)
        given = {"format": form, "delimiter": delimiter, "decimal": decimal} | {
            "header": header,
            "axis": axis,
        }
        path = write_start(found, out or Path(f"{file.stem}.toml"), given)
        first = "Run it" if found.timed else "Fill in the sampling period (dt) and run it"
        say(f"Problem: {path}\n{first}: backsight run {shlex.quote(str(path))} --out out")


def _listed(
    file: Path,
    form: str | None,
    delimiter: str | None,
    decimal: str | None,
    header: int | None,
    axis: int | None,
) -> "FileColumns":
    from backsight.data import list_columns

    # Which words and numbers there are is the function's to say.
    return list_columns(
        file,
        format=form,
        delimiter=delimiter,
        decimal=cast(Literal[".", ","] | None, decimal),
        header=header,
        axis=cast(Literal[0, 1] | None, axis),
    )

"""The command that makes code of an estimator."""

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, cast

import typer

from backsight.cli._choosing import estimator_of
from backsight.cli._console import say, told
from backsight.cli._options import Env, Force, Outside

if TYPE_CHECKING:
    from backsight.export.fmi import Platform

Out = Annotated[
    Path, typer.Option("--out", "-o", help="Folder for the code; with --fmi the file, *.fmu.")
]


def export(
    problem: Annotated[Path, typer.Argument(help="Problem file (TOML).")],
    estimator: Annotated[str, typer.Option("--estimator", "-e", help="Its name in the file.")],
    out: Out,
    name: Annotated[
        str | None, typer.Option(help="Prefix in C [from the estimator's name].")
    ] = None,
    precision: Annotated[
        str | None, typer.Option(help="double or float; an FMU is always double.")
    ] = None,
    accuracy: Annotated[
        float,
        typer.Option(help="Of float: largest deviation in standard deviations; inf: not tried."),
    ] = 0.01,
    tunable: Annotated[
        list[str] | None,
        typer.Option(
            help="What stays changeable: sigma_y, sigma_w, x0, sigma_x0, lower, upper, a number of "
            "the estimator (alpha, lam), a parameter of the model; several times."
        ),
    ] = None,
    fmi: Annotated[bool, typer.Option("--fmi", help="Write an FMU, FMI 3.0.")] = False,
    platform: Annotated[
        list[str] | None,
        typer.Option(help="Of an FMU: x86_64-linux, aarch64-linux, x86_64-windows; several times."),
    ] = None,
    template: Annotated[
        str | None,
        typer.Option(help="arduino: the folder is a sketch, for PlatformIO, too."),
    ] = None,
    force: Force = False,
    outside: Outside = None,
    env: Env = None,
) -> None:
    """Write an estimator as C99 for a controller, with a self-test from the recording.

    With --fmi it is an FMU for co-simulation and scheduled execution, with sources and libraries.
    """
    with told():
        from backsight.errors import EngineError
        from backsight.export import export_c, export_fmu
        from backsight.problem import load
        from backsight.problem.recorded import recording_of

        if fmi and precision not in (None, "double"):
            raise EngineError(f"an FMU computes in double, not in {precision}: leave --precision")
        if platform and not fmi:
            raise EngineError("--platform is for FMUs: add --fmi")
        if template and fmi:
            raise EngineError("--template is for C, not for an FMU: leave one of them")
        read = load(problem)
        chosen = estimator_of(estimator, read.estimators)
        read.check_by_sample([estimator], "exported code")
        recording = recording_of(read, outside=outside or (), env=env or ())
        prefix = name or _prefix(estimator)
        if fmi:
            export_fmu(
                chosen,
                read.model,
                recording,
                out,
                name=prefix,
                tunable=tunable or None,
                # Which words there are is the function's to say.
                platforms=cast("list[Platform] | None", platform or None),
                force=force,
            )
            say(f"FMU: {out}")
            return
        export_c(
            chosen,
            read.model,
            recording,
            out,
            name=prefix,
            precision=cast(Literal["double", "float"], precision or "double"),
            accuracy=accuracy,
            tunable=tunable or None,
            template=cast(Literal["arduino"] | None, template),
            force=force,
        )
        say(f"Code: {out}" + ("" if template else f"\nTest: make -C {out} test"))


def _prefix(estimator: str) -> str:
    """Name in C for an estimator's name in a problem file: "CS-MHE" becomes "cs_mhe"."""
    return re.sub(r"[^a-z0-9]+", "_", estimator.lower()).strip("_")

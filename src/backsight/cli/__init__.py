"""The command line.

Commands import what they need when they run, so that help and version come at once.
"""

import io
import sys
import textwrap
from pathlib import Path
from typing import Annotated

import typer

from backsight.cli import _live, _recordings, _workbench
from backsight.cli._arrays import numpy_only
from backsight.cli._choosing import estimator_of
from backsight.cli._console import bar, say, tell, told, warn, width
from backsight.cli._exporting import export
from backsight.cli._fleet import fleet
from backsight.cli._options import Env, Force, Out, Outside
from backsight.cli._parts import run_parts
from backsight.cli._reporting import report_again
from backsight.cli._tuning import tune
from backsight.errors import ProblemError

SHORT = {"help_option_names": ["-h", "--help"]}
# Markup would take the brackets of "[from the estimator's name]" for a style.
app = typer.Typer(
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings=SHORT,
)
study = typer.Typer(
    no_args_is_help=True,
    help="Reproduce a paper or work on a real system.",
    rich_markup_mode=None,
    context_settings=SHORT,
)
app.add_typer(study, name="study")
app.command("columns", short_help="Show the columns of a recording and what looks wrong.")(
    _recordings.show_columns
)
app.command("init")(_recordings.write_problem)
app.command("open", short_help="Open the workbench in a browser; no Python needed.")(
    _workbench.open_page
)
app.command("live", short_help="Estimate while samples come, from the wire or a file.")(_live.live)


@app.callback(invoke_without_command=True)
def main(
    version: Annotated[bool, typer.Option("--version", help="Show the version and exit.")] = False,
) -> None:
    """Estimate states, parameters and unknown forces from a model and measurements."""
    # A pipe may have an encoding without µ and ±: no reason to lose the results.
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
    if version:
        import importlib.metadata

        typer.echo(importlib.metadata.version("backsight"))
        raise typer.Exit


@app.command("run", short_help="Run the estimators of a problem file and compare them.")
def run_file(
    problem: Annotated[Path, typer.Argument(help="Problem file (TOML).")],
    out: Out,
    force: Force = False,
    outside: Outside = None,
    env: Env = None,
) -> None:
    """Run the estimators of a problem file over its recording and compare them.

    A recording with a table [recording.parts] need not fit into memory; a
    run that was interrupted goes on when it is started again. The exit
    code is 0 if all went well, 1 if an estimator failed (the others are
    written), and 2 if the problem, the recording or the folder is at
    fault and nothing is written. After an interrupt it is 130, and what
    had finished is written.
    """
    with told():
        numpy_only()
        from backsight.problem import load, run_problem
        from backsight.problem.methods import refusals
        from backsight.problem.running import ESTIMATES, PAGE
        from backsight.run.estimation import failure

        for sentence in refusals():
            warn(sentence)
        with bar() as advance:
            advance("reading", 0.0)
            read = load(problem)
            advance("reading", 1.0)
        if read.recording.parts is not None:
            return run_parts(read, out, env or ())
        with bar() as advance:
            results = run_problem(
                read,
                out,
                progress=lambda name, k, n: advance(name, k / n),
                tell=warn,
                force=force,
                outside=outside or (),
                env=env or (),
                interrupted=lambda names: warn(
                    f"interrupted: {', '.join(names)} left out; the others are written, unless "
                    "there is another interrupt"
                ),
            )
        say(f"{read.title}\n\n{results.table(read.reference, width=width())}\n")
        for sentence in results.verdicts(read.reference):
            say(textwrap.fill(sentence, width(), subsequent_indent="  "))
        say(f"\nReport: {out / PAGE}" if read.report else f"\nEstimates: {out / ESTIMATES}")
    failures = {name: failure(result) for name, result in results.items()}
    for name, reason in failures.items():
        if reason:
            tell(f"{name}: {reason}")
    if len(results) < len(read.estimators):
        raise typer.Exit(130)
    if any(failures.values()):
        raise typer.Exit(1)
    return None


@app.command(short_help="Say whether the recording can show what is asked for.")
def check(
    problem: Annotated[Path, typer.Argument(help="Problem file (TOML).")],
    certify: Annotated[
        str | None,
        typer.Option(help="Estimator that should equal the Kalman filter on the linearised model."),
    ] = None,
    outside: Outside = None,
    env: Env = None,
) -> None:
    """Say whether the recording can show what is asked for, and which sensor would help.

    It also says how well constant parameters can be told, and whether an
    unknown force can explain them; whether outputs and inputs belong to the
    same samples, whether units and signs are those of the model, and how
    the estimators go from sample to sample. The exit code is 0
    if nothing is wrong, 1 if a state that does not fade by itself cannot
    be seen, if times, units or signs are wrong, if an output jumps like
    an angle or is rounded more coarsely than its noise, if an integration
    step is too coarse, or if an estimator is not what it is asked to be, and 2 if
    the problem or the recording is at fault.
    """
    with told():
        numpy_only()
        from backsight.problem import load, seeing
        from backsight.problem.recorded import recording_of
        from backsight.run.diagnosis import aligned, expected
        from backsight.run.diagnosis import certify as certified

        read = load(problem)
        chosen = None if certify is None else estimator_of(certify, read.estimators)
        data = recording_of(read, outside=outside or (), env=env or ())
        found = seeing.examine(read, data)
        timing = aligned(read.estimators, read.model, data)
        bands = expected(read.estimators, read.model, data) if found.observable else None
        steps, coarse = seeing.integration(read, data), seeing.coarse_steps(read, data)
        doubtful, counted = seeing.readings(read, data)
        say(f"{read.title}\n\n{read.model}\n")
        for sentence in [
            *found.lines(),
            *([] if found.detectable else seeing.remedies(read, data)),
            *(bands.lines() if bands else []),
            *(timing.lines() if timing else []),
            *seeing.priors_at_poles(read),
            *(timing.remedies(float(data.attrs["dt"])) if timing else []),
            *(doubtful + counted),
            *steps,
            *coarse,
        ]:
            say(textwrap.fill(sentence, width(), subsequent_indent="  "))
        certificate = None if chosen is None else certified(chosen, read.model, data)
        if certificate is not None:
            say(f"\n{certificate.table()}\n")
            for sentence in certificate.lines():
                say(textwrap.fill(sentence, width(), subsequent_indent="  "))
    fine = found.detectable and (timing is None or timing.sound) and not coarse and not doubtful
    if not (fine and (certificate is None or certificate.holds)):
        raise typer.Exit(1)


app.command(short_help="Find noise, prior and settings from the recording.")(tune)
app.command(short_help="Write an estimator as C99 or FMU for a controller.")(export)
app.command(short_help="Run a problem over many recordings, with many settings.")(fleet)


app.command("report")(report_again)


@app.command("methods", short_help="List the estimators and their settings.")
def list_methods(
    name: Annotated[
        str | None, typer.Argument(help="A kind, such as ekf: what every setting means.")
    ] = None,
) -> None:
    """List the estimators with the settings that a problem file may give them."""
    with told():
        from backsight.problem.methods import method, methods

        say(methods(tell=warn) if name is None else method(name))


@app.command("schema", short_help="Print a JSON schema of problem files for editors.")
def print_schema() -> None:
    """Print a JSON schema of problem files, for editors that complete and check TOML.

    Name it in the first line of a problem file, #:schema problem.schema.json
    """
    import json

    from backsight.problem.json_schema import json_schema

    # As it is: it holds no text of a file, and a line is a line.
    typer.echo(json.dumps(json_schema(tell=warn), indent=2))


@study.command("list")
def study_list() -> None:
    """List the studies."""
    with told():
        from backsight.studies import studies

        for name, entry in studies(tell=warn).items():
            say(f"{name}: {entry.title}")


@study.command("run")
def study_run(
    name: Annotated[str, typer.Argument(help="Name of the study, see `backsight study list`.")],
    out: Out,
    seeds: Annotated[
        int | None,
        typer.Option(min=0, help="Number of simulated recordings; if not given, the study's own."),
    ] = None,
    recording: Annotated[
        list[Path] | None, typer.Option(help="Further recording; may be given several times.")
    ] = None,
    force: Force = False,
) -> None:
    """Run a study: figures, tables, a page to read, and checks.json."""
    with told():
        from backsight.plugins import unknown
        from backsight.studies import GROUP, studies

        known = studies(tell=warn)
        if name not in known:
            raise ProblemError(f"there is no study '{name}', {unknown(name, known, group=GROUP)}")
        entry = known[name]
        count = entry.seeds if seeds is None else seeds
        with bar() as advance:
            findings = entry.run(
                out,
                seeds=range(count),
                recordings=recording or [],
                progress=advance,
                force=force,
            )
        say(f"{findings}\n\nPage: {findings.page}")

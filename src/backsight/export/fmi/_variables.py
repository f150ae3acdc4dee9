"""Variables of an FMU: what they are called, where their values are, and how C gets at them."""

import dataclasses
import re
from collections.abc import Iterator, Sequence
from typing import Literal, TypeAlias

import numpy as np

from backsight.algebra.symmetric import side
from backsight.engine.recursion import Channel
from backsight.errors import BacksightError, EngineError
from backsight.estimators.base import ESTIMATE_CHANNELS
from backsight.export._followed import LOWER, MEAN, PRIOR, SIGMA, SPREAD, UPPER, WALK
from backsight.export._opened import PARAMETERS
from backsight.export._written import Written, one_line
from backsight.models.signals import Signal
from backsight.types import Array

Causality: TypeAlias = Literal["independent", "parameter", "input", "output"]

Z95 = 1.959963984540054
"""Standard deviations from the middle to the end of a 95 % band."""

TOLD = {c.name for c in ESTIMATE_CHANNELS}
"""Channels that every estimator has, which have variables of their own."""


@dataclasses.dataclass(frozen=True)
class Variable:
    """One number that an importer sees.

    Parameters
    ----------
    reference : int
        Value reference.
    name : str
        Structured, see `structured`.
    causality : {"independent", "parameter", "input", "output"}
    about : str
    unit : str
    start : float
        Of parameters and inputs what is set first; of outputs the value before the first sample.
    source : str
        Expression in C of an output; empty if it is computed beside the estimator.
    whole : bool
        It is an integer.
    fixed : bool
        A parameter that counts before the first sample only.
    """

    reference: int
    name: str
    causality: Causality
    about: str
    unit: str = ""
    start: float = float("nan")
    source: str = ""
    whole: bool = False
    fixed: bool = False


def variables(code: Written) -> tuple[Variable, ...]:
    """All variables, in the order of their value references.

    Raises
    ------
    EngineError
        If two would have the same name.
    """
    found: list[Variable] = []
    for draft in _drafts(code):
        found.append(dataclasses.replace(draft, reference=len(found)))
    names = [v.name for v in found]
    if twice := sorted({n for n in names if names.count(n) > 1}):
        raise EngineError(f"two variables of the FMU would be called {twice[0]}: rename one")
    return tuple(found)


def clock_reference(found: Sequence[Variable]) -> int:
    """Value reference of the clock of the samples, which has no value."""
    return len(found)


def structured(group: str, name: str) -> str:
    """``group.name`` in the grammar of structured names: what is no identifier is quoted."""
    if re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", name):
        return f"{group}.{name}"
    safe = re.sub(r"[^ !#-&(-\[\]-~]", lambda m: f"(U+{ord(m[0]):04X})", one_line(name))
    return f"{group}.'{safe}'"


def _drafts(code: Written) -> Iterator[Variable]:
    yield Variable(0, "time", "independent", "time of the coming sample", "s")
    yield from _parameters(code)
    yield from _inputs(code)
    yield from _outputs(code)


def _parameters(code: Written) -> Iterator[Variable]:
    about = {
        SIGMA: "standard deviation of the measurement",
        WALK: "standard deviation of the random walk in a sample",
        MEAN: "state before the first sample",
        SPREAD: "standard deviation of the state before the first sample",
        LOWER: "lower bound of the state",
        UPPER: "upper bound of the state",
        PARAMETERS: "parameter of the model",
    }
    for field, signals in code.open.signals.items():
        group = "parameter" if field == PARAMETERS else field
        for s in signals:
            # A number of the estimator has no group.
            name = structured(group, s.name) if field in about else field
            told = about.get(field, "setting of the estimator")
            yield Variable(0, name, "parameter", told, s.unit, s.value, fixed=field in PRIOR)


def _inputs(code: Written) -> Iterator[Variable]:
    model = code.model
    for s in model.inputs:
        yield Variable(0, structured("u", s.name), "input", "known input", s.unit, 0.0)
    for s in model.outputs:
        about = "measurement; NaN: not made" if s.dummy is None else "no sensor: leave it"
        start = 0.0 if s.dummy is None else s.dummy
        yield Variable(0, structured("y", s.name), "input", about, s.unit, start)
    weight = "1: measured, 0: not" + (
        "; between and above: nominal by actual standard deviation" if code.estimator.weighs else ""
    )
    for s in model.outputs:
        yield Variable(0, structured("mask", s.name), "input", weight, "", 1.0)


def _outputs(code: Written) -> Iterator[Variable]:
    mean, std = _prior(code)
    for i, s in enumerate(code.model.states):
        x, sd = f"x_hat[{i}]", f"deviation(P[{_diagonal(i, code.model.nx)}])"
        first, spread = float(mean[i]), float(std[i])
        low, high = first - Z95 * spread, first + Z95 * spread
        yield _output("x_hat", s, "estimate", x, first)
        yield _output("x_std", s, "standard deviation of the estimate", sd, spread)
        yield _output("x_lower", s, "lower end of the 95 % band", f"{x} - {Z95!r} * {sd}", low)
        yield _output("x_upper", s, "upper end of the 95 % band", f"{x} + {Z95!r} * {sd}", high)
    for i, s in enumerate(code.model.outputs):
        yield _output("y_hat", s, "output computed from the estimate", f"y_hat[{i}]")
    for i, s in enumerate(code.model.outputs):
        yield _output("e", s, "innovation: measurement minus prediction", f"e[{i}]")
    yield Variable(0, "nis", "output", "normalised innovation squared, NaN if nothing was measured")
    bits = "sum of status bits, see the documentation"
    yield Variable(0, "status", "output", bits, start=0.0, source="status[0]", whole=True)
    for channel, size in zip(code.recursion.channels, code.recursion.output_sizes, strict=True):
        if channel.name not in TOLD:
            yield from _channel(code, channel, size)


def _channel(code: Written, channel: Channel, size: int) -> Iterator[Variable]:
    """What else an estimator puts out; of a covariance the standard deviations."""
    units = {s.name: s.unit for s in (*code.model.parameters, *code.model.states)}
    units |= {s.name: s.unit for s in code.model.outputs} if channel.dims == ("output",) else {}
    if not channel.dims:
        source = f"{channel.name}[0]"
        yield Variable(0, channel.name, "output", "told by the estimator", source=source)
        return
    labels = _labels(code, channel, side(size) if channel.symmetric else size)
    name = channel.name if not channel.symmetric else f"{channel.name.removeprefix('P_')}_std"
    for i, label in enumerate(labels):
        at = _diagonal(i, len(labels)) if channel.symmetric else i
        value = f"{channel.name}[{at}]"
        source = f"deviation({value})" if channel.symmetric else value
        unit = units.get(label, "") if channel.name[:2] in ("d_", "P_", "x_") else ""
        about = "told by the estimator"
        yield Variable(0, structured(name, label), "output", about, unit, source=source)


def _labels(code: Written, channel: Channel, size: int) -> Sequence[str]:
    if channel.labels:
        return channel.labels
    groups = {"state": code.model.states, "output": code.model.outputs}
    if channel.dims[0] in groups:
        return [s.name for s in groups[channel.dims[0]]]
    return [f"_{i}" for i in range(size)]


def _output(
    group: str, signal: Signal, about: str, source: str, start: float = float("nan")
) -> Variable:
    name = structured(group, signal.name)
    return Variable(0, name, "output", about, signal.unit, start, source)


def _diagonal(i: int, n: int) -> int:
    """Where the i-th entry of the diagonal is in a lower triangle, column by column."""
    return i * n - i * (i - 1) // 2


def _prior(code: Written) -> tuple[Array, Array]:
    """Mean and standard deviations before the first sample, NaN if the estimator has no prior."""
    try:
        prior = code.estimator.assumed[1]
        return prior.mean(code.model), np.sqrt(np.diag(prior.covariance(code.model)))
    except BacksightError:
        unknown = np.full(code.model.nx, np.nan)
        return unknown, unknown

"""Quantities that no sensor measures: virtual outputs of a model."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import casadi as ca

from backsight.description import checked
from backsight.errors import ModelError
from backsight.models.model import Model
from backsight.models.signals import Named, Signal, Virtual
from backsight.models.text.expressions import check_names, expression

RATE = "_dot"
"""Behind the name of a state: its rate in a formula."""

Formula = str | Callable[..., Any]
"""Text, or ``(x, u, p, dx)`` to an expression."""


@checked(ModelError)
def with_virtual(model: Model, quantities: Mapping[str, Formula | tuple[Formula, str]]) -> Model:
    r"""Add quantities that no sensor measures: strain, stress, force in a member, acceleration.

    Every estimator then puts out their estimate ``z_hat`` with its standard deviation ``z_std``.

    .. math:: z = g(x, u, p, \dot x), \qquad \dot x = f(x, u, p) + w

    Parameters
    ----------
    model : Model
    quantities : dict
        Name to formula, or to ``(formula, unit)``. A formula is text with the names of states,
        inputs, parameters, outputs (of the model, without noise) and virtual outputs before it; in
        continuous time the rate of a state ``v`` is ``v_dot``. Or a function ``(x, u, p, dx)`` with
        access by name as in `Model`; ``dx.v`` is the rate of the state v (in discrete time, its
        next value).

    Returns
    -------
    Model
        With the virtual outputs behind those that it has.

    Raises
    ------
    ModelError
        If a formula cannot be read, gives more than one value, or a name is taken.

    Notes
    -----
    A rate contains the process noise: what an estimator believes to push the state from sample to
    sample, as a constant over the sampling period. So the band of an acceleration is that of its
    mean from this sample to the next. Write the right side of the equation in place of the rate to
    leave that out. See the page on virtual sensors.

    Examples
    --------
    >>> from backsight.models.builtin import sdof
    >>> stage = with_virtual(sdof(k=100.0, b=1.0), {"spring": ("k*q", "N"), "a": ("v_dot", "m/s2")})
    >>> [s.name for s in stage.virtual.signals]
    ['spring', 'a']
    """
    given = {n: q if isinstance(q, tuple) else (q, "") for n, q in quantities.items()}
    signals = tuple(Signal(name=n, unit=unit) for n, (_, unit) in given.items())
    check_names(given)
    before = () if model.virtual is None else model.virtual.signals
    x, u, p, w = symbols = [
        ca.SX.sym(n, k) for n, k in (("x", model.nx), ("u", model.nu), ("p", len(model.parameters)))
    ] + [ca.SX.sym("w", model.nx)]
    rates = model.f.call([x, u, p])[0] + w
    earlier = [] if model.virtual is None else ca.vertsplit(model.virtual.g.call(symbols)[0])
    known = _names(model, x, u, p, rates)
    known |= {s.name: row for s, row in zip(before, earlier, strict=True)}
    named = [
        Named(kind, [s.name for s in group], vector)
        for kind, group, vector in (
            ("state", model.states, x),
            ("input", model.inputs, u),
            ("parameter", model.parameters, p),
            ("state", model.states, rates),
        )
    ]
    rows = []
    for name, (formula, _) in given.items():
        where = f"virtual output '{name}'"
        row = formula(*named) if callable(formula) else expression(formula, known, where=where)
        known[name] = _one_value(row, where)
        rows.append(known[name])
    g = ca.Function("g", symbols, [ca.densify(ca.vertcat(*earlier, *rows))])
    return dataclasses.replace(model, virtual=Virtual((*before, *signals), g))


def _names(model: Model, x: ca.SX, u: ca.SX, p: ca.SX, rates: ca.SX) -> dict[str, ca.SX]:
    """What a formula may name; states, inputs and parameters go before outputs and rates."""
    groups = ((model.outputs, model.h.call([x, u, p])[0]),)
    groups += ((model.parameters, p), (model.inputs, u), (model.states, x))
    known = {}
    if model.continuous:
        known = {f"{s.name}{RATE}": rates[i] for i, s in enumerate(model.states)}
    for signals, vector in groups:
        known |= {s.name: vector[i] for i, s in enumerate(signals)}
    return known


def _one_value(row: Any, where: str) -> ca.SX:
    try:
        value = ca.SX(row)
    except NotImplementedError:
        raise ModelError(
            f"{where}: its function returns {row!r}, not a number or expression"
        ) from None
    if value.numel() != 1:
        raise ModelError(
            f"{where}: its function returns {value.numel()} values; give one name each"
        )
    return value

"""Quantities that no sensor measures: virtual outputs of a model."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import casadi as ca

from backsight.algebra.expressions import check_names, expression
from backsight.description import checked
from backsight.errors import ModelError, nearest
from backsight.models.model import Model
from backsight.models.signals import Named, Signal, Virtual, traced

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
    x, u, p, w = symbols = _symbols(model)
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
        if callable(formula):
            row = traced(formula, *named)
        else:
            row = expression(formula, known, where=where)
        known[name] = _one_value(row, where)
        rows.append(known[name])
    g = ca.Function("g", symbols, [ca.densify(ca.vertcat(*earlier, *rows))])
    return dataclasses.replace(model, virtual=Virtual((*before, *signals), g))


def built_with_virtual(
    build: Callable[[Mapping[str, Any]], Model],
    sensors: Mapping[str, Any],
    virtual: Mapping[str, Any],
) -> Model:
    """Structure with sensors of which some are not there: these become virtual outputs.

    Parameters
    ----------
    build : callable
        Sensors, name to ``(kind, place)``, to the model.
    sensors, virtual : dict
        What is measured, and what is wanted where no sensor is.

    Raises
    ------
    ModelError
        As `build`; if a name is used twice.
    """
    twice = [name for name in virtual if name in sensors]
    if twice:
        raise ModelError(f"the virtual output '{twice[0]}' has the name of another signal")
    # An acceleration is the rate of the velocity there, and contains the noise of that rate.
    beside = {
        name: f"{name}_velocity_"
        for name, given in virtual.items()
        if isinstance(given, tuple) and str(given[0]).endswith("acceleration")
    }
    velocities = {other: ("velocity", virtual[name][1]) for name, other in beside.items()}
    whole = build({**sensors, **virtual, **velocities})
    x, u, p, w = symbols = _symbols(whole)
    rows = dict(
        zip(
            [s.name for s in whole.outputs],
            ca.vertsplit(whole.h.call([x, u, p])[0]),
            strict=True,
        )
    )
    g = [
        rows[name] + ca.mtimes(ca.jacobian(rows[beside[name]], x), w)
        if name in beside
        else rows[name]
        for name in virtual
    ]
    known = {s.name: s for s in whole.outputs}
    return dataclasses.replace(
        whole,
        h=ca.Function("h", [x, u, p], [ca.vertcat(*(rows[name] for name in sensors))]),
        outputs=tuple(known[name] for name in sensors),
        virtual=Virtual(
            tuple(known[name] for name in virtual),
            ca.Function("g", symbols, [ca.densify(ca.vertcat(*g))]),
        ),
    )


@checked(ModelError)
def with_dummies(model: Model, names: Sequence[str]) -> Model:
    r"""Turn virtual outputs into dummy measurements: outputs that read zero in every sample.

    Accelerations and velocities do not tell where a structure is: what is integrated from them
    drifts, and a constant force shows in none of them. That a displacement stays within a known
    size around zero is knowledge, too, and is told like a measurement.

    Parameters
    ----------
    model : Model
        With virtual outputs of these names: displacements, mostly.
    names : sequence of str
        As many as there are forces to follow, at least.

    Returns
    -------
    Model
        With an output for each, in the place of the virtual output. Recordings need no such
        channel. The noise needs a deviation, ``sigma_y``; with the size s of the displacement
        (root mean square) and the time :math:`\tau` over which it stays on one side, that is

        .. math:: \sigma = s \sqrt{2 \tau / \Delta t},

        since what is white per sample would otherwise be believed :math:`\tau / \Delta t` times.

    Raises
    ------
    ModelError
        If there is no such virtual output, or it contains process noise (an acceleration).

    References
    ----------
    Naets, Cuadrado, Desmet, "Stable force identification in structural dynamics using Kalman
    filtering and dummy-measurements", 2015, Mechanical Systems and Signal Processing 50-51,
    235-248, doi:10.1016/j.ymssp.2014.05.042.

    Examples
    --------
    >>> from backsight.models.builtin import sdof
    >>> model = with_dummies(with_virtual(sdof(k=0.0, b=0.0), {"stays": ("q", "m")}), ["stays"])
    >>> print(model)
    sdof (continuous)
    ├── states      q [m], v [m/s]
    ├── inputs      u [N]
    ├── outputs     y [m], stays [m]
    └── parameters  k = 0, b = 0, c = 1
    """
    known = () if model.virtual is None else model.virtual.signals
    places = [s.name for s in known]
    for name in names:
        if name not in places:
            raise ModelError(
                f"there is no virtual output '{name}' to make a dummy measurement of: "
                f"{nearest(name, places)}"
            )
    if model.virtual is None or not names:
        return model
    x, u, p, w = symbols = _symbols(model)
    rows = model.virtual.g.call(symbols)[0]
    chosen = [places.index(n) for n in names]
    if ca.depends_on(rows[chosen], w):
        raise ModelError(
            "a dummy measurement cannot be of a rate, which contains process noise: take "
            "displacements"
        )
    rest = [i for i in range(len(places)) if i not in chosen]
    read = ca.substitute(rows[chosen], w, ca.SX.zeros(model.nx))
    dummies = [dataclasses.replace(known[i], dummy=0.0) for i in chosen]
    g = ca.Function("g", symbols, [ca.densify(rows[rest])])
    return dataclasses.replace(
        model,
        h=ca.Function("h", [x, u, p], [ca.vertcat(model.h.call([x, u, p])[0], read)]),
        outputs=(*model.outputs, *dummies),
        virtual=Virtual(tuple(known[i] for i in rest), g) if rest else None,
    )


def _symbols(model: Model) -> list[ca.SX]:
    """States, inputs, parameters and process noise."""
    sizes = {"x": model.nx, "u": model.nu, "p": len(model.parameters), "w": model.nx}
    return [ca.SX.sym(name, size) for name, size in sizes.items()]


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

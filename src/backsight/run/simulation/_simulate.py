"""Make a recording from a model, with its truth: jumps, disturbances and noise included."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Annotated

import casadi as ca
import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from backsight.description import Called, Count, Positive, Whole, checked
from backsight.discrete.runge_kutta import Hold, Integrator, RungeKutta
from backsight.engine import vm
from backsight.engine.building import built_alone
from backsight.engine.loops import scan
from backsight.engine.recursion import Channel, Recursion
from backsight.errors import DataError, TuningError
from backsight.models.model import Model
from backsight.models.signals import vector
from backsight.models.singular import culprit
from backsight.run.simulation._measured import measured_recording
from backsight.run.simulation._scenario import (
    Disturbance,
    Push,
    Steps,
    disturbance_of,
    input_columns,
    parameter_steps,
)
from backsight.types import Array, ByName

SCHEME: RungeKutta = "dopri5"
"""Fifth order and on a finer grid than any estimator, so that truth and model are not the same."""

BLOCK = 1000
"""Samples whose sub-steps are laid out in memory at once."""


@checked(DataError)
def simulate(
    model: Model,
    u: ArrayLike | Mapping[str, ArrayLike],
    *,
    dt: Annotated[Positive, Called("the sampling period dt")],
    x0: ByName | None = None,
    parameters: Mapping[str, float] | None = None,
    changes: Mapping[float, Mapping[str, float]] | None = None,
    disturbances: Mapping[str, Disturbance] | None = None,
    sigma_y: ByName = 0.0,
    seed: Whole = 0,
    substeps: Annotated[Count, TuningError] = 20,
    scheme: Annotated[RungeKutta, TuningError] = SCHEME,
    hold: Annotated[Hold, TuningError] = "zoh",
) -> xr.Dataset:
    r"""Simulate a model and measure it.

    A continuous-time model is integrated in `substeps` equal steps per sample, by the fifth-order
    method of Dormand and Prince unless `scheme` says another; the first sample is at time 0 and in
    the state `x0`.

    Parameters
    ----------
    model : Model
    u : (n, nu) array, or dict of (n,) arrays by name
        Inputs of all samples; (n,) does for one input, (n, 0) for none.
    dt : float
        Sampling period [s].
    x0 : dict, sequence or number, optional
        State at the first sample; states that a dict leaves out take their value in the model.
    parameters : dict, optional
        Values that differ from those in the model.
    changes : dict, optional
        Time [s] to the parameters that jump then, ``{0.2: {"k": 9e6}}``. The state stays
        continuous. Times are rounded to the nearest sub-step, ``dt / substeps`` (to the nearest
        sample if the model is discrete); a sample at that time is already measured with the new
        values.
    disturbances : dict, optional
        State to what is added to its derivative (to its next value, if the model is discrete):
        one value per sample, held until the next, or a function of time that takes and returns
        arrays, taken at the middle of every sub-step and held over it (at the sample, if the model
        is discrete).
    sigma_y : dict, sequence or number
        Standard deviation of the white measurement noise of every output.
    seed : int
        Of the noise, ``numpy.random.default_rng(seed)``.
    substeps : int
        Steps per sample; not used by a discrete-time model.
    scheme : str
        Runge-Kutta method; an implicit one, such as "radau", for a stiff model, see `Integrator`.
    hold : {"zoh", "foh"}
        Input between samples: held, or a ramp to the next sample (the last value is held).

    Returns
    -------
    xarray.Dataset
        A recording with the truth beside it: ``x_true (time, state)`` holds states, parameters and
        virtual outputs at the samples, so that an estimator which has them among its states or
        virtual outputs is measured against them.

    Raises
    ------
    ModelError
        If a state, input or parameter is not in the model.
    DataError
        If a number has the wrong size or is not finite, a change lies outside the recording, or
        the simulation leaves the finite numbers.
    TuningError
        If `substeps` or `hold` is not possible.

    Examples
    --------
    >>> from backsight.models.builtin import sdof
    >>> free = simulate(sdof(k=100.0, b=0.0), [0.0, 0.0, 0.0], dt=0.1, x0={"q": 1.0})
    >>> free["y"].values[:, 0].round(6)
    array([ 1.      ,  0.540302, -0.416147])
    """
    if model.dt is not None and not np.isclose(model.dt, dt, rtol=1e-9):
        raise DataError(f"the model has dt = {model.dt:g} s; it cannot be simulated with {dt:g} s")
    U = input_columns(model, u)
    n = len(U)
    fine = Integrator(scheme, substeps if model.continuous else 1, hold)
    grid = dt / fine.steps
    theta = parameter_steps(model, parameters or {}, changes or {}, grid=grid, end=n * dt)
    pushes = {
        model.index(state): disturbance_of(state, push, n)
        for state, push in (disturbances or {}).items()
    }
    values = np.array([s.value for s in model.states])
    x = _finite(vector({} if x0 is None else x0, model.states, what="x0", default=values), "x0")
    sigma = vector(sigma_y, model.outputs, what="sigma_y", default=np.zeros(model.ny))
    if (_finite(sigma, "sigma_y") < 0).any():
        raise DataError(f"sigma_y is {sigma}; it must not be negative")

    X, Y, Z = _integrate(model, fine, x, U=U, theta=theta, pushes=pushes, dt=dt)
    of_samples = theta.at(np.arange(n) * fine.steps)
    _check_finite(model, X, Y, U, of_samples, dt)

    return measured_recording(
        model,
        dt=dt,
        u=U,
        x=X,
        y=Y,
        z=Z,
        parameters=of_samples,
        sigma=sigma,
        seed=seed,
    )


def _integrate(
    model: Model,
    fine: Integrator,
    x: Array,
    *,
    U: Array,
    theta: Steps,
    pushes: Mapping[int, Push],
    dt: float,
) -> tuple[Array, Array, Array]:
    """States (n, nx), outputs without noise (n, ny) and virtual ones (n, nz), in blocks."""
    recursion = _recursion(model, fine, pushed=list(pushes), dt=dt)
    n, m = len(U), fine.steps
    X, Y = np.empty((n, model.nx)), np.empty((n, model.ny))
    Z = np.empty((n, 0 if model.virtual is None else len(model.virtual.signals)))
    for first in range(0, n, BLOCK):
        part = slice(first, min(first + BLOCK, n))
        ahead = np.minimum(np.arange(part.start, part.stop) + 1, n - 1)
        steps = np.arange(part.start * m, part.stop * m)
        times = np.asarray(steps + (0.5 if model.continuous else 0.0), float) * (dt / m)
        P = theta.at(steps)
        W = np.empty((len(steps), len(pushes)))
        for k, push in enumerate(pushes.values()):
            W[:, k] = push(steps // m, times)
        data = [U[part], U[ahead], *(rows.reshape(len(ahead), -1) for rows in (P, W))]
        x, (X[part], Y[part], Z[part]) = vm.run(recursion, data, carry=x)
    return X, Y, Z


@built_alone
def _recursion(model: Model, fine: Integrator, *, pushed: Sequence[int], dt: float) -> Recursion:
    """``(x, u, u_next, P, W) -> (x_next, x, y, z)``; P and W hold the values of all sub-steps."""
    m, nx, nu, nw = fine.steps, model.nx, model.nu, len(pushed)
    n_par = len(model.parameters)
    x, p, w = ca.SX.sym("x", nx), ca.SX.sym("p", n_par), ca.SX.sym("w", nw)
    u, ua, ub = (ca.SX.sym(name, nu) for name in ("u", "ua", "ub"))
    push = ca.SX.zeros(nx)
    for k, i in enumerate(pushed):
        push[i] = w[k]
    if model.continuous:
        h = dt / m
        x_next = fine.substep(lambda xi, ui: model.f(xi, ui, p) + push, x, ua=ua, ub=ub, h=h)
    else:
        x_next = model.f(x, ua, p) + push
    substep = ca.Function("truth", [x, p, w, ua, ub], [x_next])
    virtual = ca.SX(0, 1) if model.virtual is None else model.virtual.g(x, u, p, push)
    measure = ca.Function("measure", [x, u, p, w], [model.h(x, u, p), virtual])

    X, U, U_next = ca.MX.sym("x", nx), ca.MX.sym("u", nu), ca.MX.sym("u_next", nu)
    P, W = ca.MX.sym("P", n_par * m), ca.MX.sym("W", nw * m)
    columns, held = [ca.reshape(P, n_par, m), ca.reshape(W, nw, m)], [U, U]
    if fine.hold == "foh":
        columns, held = [*columns, *_ramp(nu, m)(U, U_next)], []
    (after,), _ = scan(substep, m, carry=[X], xs=columns, constants=held)
    return Recursion(
        step=ca.Function(
            "simulate", [X, U, U_next, P, W], [after, X, *measure(X, U, P[:n_par], W[:nw])]
        ),
        carry0=np.zeros(nx),
        channels=(
            Channel("x_true", ("state",)),
            Channel("y", ("output",)),
            Channel("z_true", ("virtual",)),
        ),
        dt=dt,
    )


def _ramp(nu: int, m: int) -> ca.Function:
    """Inputs at the beginning and at the end of every sub-step, side by side."""
    a, b = ca.SX.sym("a", nu), ca.SX.sym("b", nu)
    grid = [a + (k / m) * (b - a) for k in range(m + 1)]
    return ca.Function("ramp", [a, b], [ca.horzcat(*grid[:-1]), ca.horzcat(*grid[1:])])


def _finite(values: Array, what: str) -> Array:
    if not np.isfinite(values).all():
        raise DataError(f"{what} is {values}; every entry must be finite")
    return values


def _check_finite(model: Model, X: Array, Y: Array, U: Array, theta: Array, dt: float) -> None:
    """Raise `DataError` with the equation that is not finite, or the first sample that is not.

    Parameters (n, np) are those of every sample.
    """
    bad = ~(np.isfinite(X).all(axis=1) & np.isfinite(Y).all(axis=1))
    if not bad.any():
        return
    k = int(np.argmax(bad))
    pairs = zip(model.parameters, theta[k], strict=True)
    now = tuple(
        dataclasses.replace(s, value=float(v), lower=-np.inf, upper=np.inf) for s, v in pairs
    )
    there = dataclasses.replace(model, parameters=now)
    points = [(X[k], U[k])]
    if k:
        x, u = X[k - 1], U[k - 1]
        rates = np.asarray(ca.evalf(there.rhs(ca.SX(x), ca.SX(u)))).ravel()
        points += [(x, u), (x + dt * rates if model.continuous else rates, u)]
    said = (culprit(there, *point) for point in points if np.isfinite(point[0]).all())
    why = next(filter(None, said), "use more sub-steps or check parameters and inputs")
    raise DataError(f"the simulation is no longer finite at t = {k * dt:g} s: {why}")

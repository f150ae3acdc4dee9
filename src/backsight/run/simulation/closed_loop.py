"""Simulate a model under a state-feedback controller, and measure it."""

from collections.abc import Callable, Mapping
from typing import Annotated, Any

import casadi as ca
import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from backsight.description import Called, Count, Positive, Whole, checked
from backsight.discrete.runge_kutta import Integrator, Scheme
from backsight.engine import vm
from backsight.engine.loops import scan
from backsight.engine.recursion import Channel, Recursion
from backsight.errors import DataError, ModelError, TuningError
from backsight.models.model import Model
from backsight.models.signals import Named, vector
from backsight.run.simulation._measured import measured_recording
from backsight.run.simulation._scenario import as_numbers, parameter_steps
from backsight.types import Array, ByName

Controller = Callable[[Named, Named], Any]
"""``(x, r) -> inputs``: expressions of the true state and the reference, as in a model."""

BLOCK = 1000
"""Samples whose sub-steps are laid out in memory at once."""


@checked(DataError)
def simulate_closed_loop(
    model: Model,
    controller: Controller,
    reference: Mapping[str, ArrayLike],
    *,
    dt: Annotated[Positive, Called("the sampling period dt")],
    x0: ByName | None = None,
    parameters: Mapping[str, float] | None = None,
    changes: Mapping[float, Mapping[str, float]] | None = None,
    sigma_y: ByName = 0.0,
    seed: Whole = 0,
    substeps: Annotated[Count, TuningError] = 10,
    scheme: Annotated[Scheme, TuningError] = "rk4",
) -> xr.Dataset:
    r"""Simulate a model whose inputs a sampled controller computes from the true state.

    .. math:: u(t) = c(x(t_k), r_k), \qquad t_k \le t < t_{k+1}

    Parameters
    ----------
    model : Model
        Continuous.
    controller : callable ``(x, r) -> list or dict of expressions``
        The inputs. The arguments give access by name to the state and to the reference, as in a
        model: ``lambda x, r: [m * r.a + k * (r.q - x.q)]``. It knows the parameters that its
        author gave it, not those that the plant has at the moment.
    reference : dict of (n,) arrays
        One value per sample.
    dt : float
        Sampling period [s].
    x0, parameters, changes, sigma_y, seed
        As in `backsight.run.simulation._simulate.simulate`.
    substeps : int
        Integration steps per sampling period.
    scheme : str
        Runge-Kutta method, see `Integrator`.

    Returns
    -------
    xarray.Dataset
        A recording with ``x_true (time, state)``, as from `simulate`.

    Raises
    ------
    ModelError
        If the model is discrete, a name is unknown, or the controller does not return one
        expression for every input.
    DataError
        If a number has the wrong size or is not finite, a change lies outside the recording, or
        the simulation leaves the finite numbers.

    Examples
    --------
    >>> from backsight.models.builtin import sdof
    >>> cart = sdof(k=0.0, b=1.0)
    >>> loop = simulate_closed_loop(
    ...     cart, lambda x, r: [100 * (r.q - x.q) - 20 * x.v], {"q": np.ones(1001)}, dt=1e-3
    ... )
    >>> round(float(loop["x_true"].sel(state="q")[-1]), 3)
    0.999
    """
    if not model.continuous:
        raise ModelError(f"model '{model.name}': the closed loop needs a continuous-time model")
    names = list(reference)
    R = _columns(reference)
    n = len(R)
    integrator = Integrator(scheme, substeps)
    grid = dt / substeps
    theta = parameter_steps(model, parameters or {}, changes or {}, grid=grid, end=n * dt)
    values = np.array([s.value for s in model.states])
    x = vector({} if x0 is None else x0, model.states, what="x0", default=values)
    sigma = vector(sigma_y, model.outputs, what="sigma_y", default=np.zeros(model.ny))
    if not (np.isfinite(x).all() and np.isfinite(sigma).all() and (sigma >= 0).all()):
        raise DataError(f"x0 = {x} and sigma_y = {sigma} must be finite, sigma_y not negative")

    recursion = _recursion(model, control(model, controller, names), integrator, dt)
    parts = []
    for first in range(0, n, BLOCK):
        rows = R[first : first + BLOCK]
        steps = np.arange(first * substeps, (first + len(rows)) * substeps)
        P = theta.at(steps).reshape(len(rows), -1)
        x, outputs = vm.run(recursion, [rows, P], carry=x)
        parts.append(outputs)
    X, U, Y, Z = (np.vstack(column) for column in zip(*parts, strict=True))
    _check_finite(X, U, dt)

    return measured_recording(
        model,
        dt=dt,
        u=U,
        x=X,
        y=Y,
        z=Z,
        parameters=theta.at(np.arange(n) * substeps),
        sigma=sigma,
        seed=seed,
    )


def control(model: Model, controller: Controller, reference: list[str]) -> ca.Function:
    """Trace a controller: ``(x, r) -> u``; raises `ModelError` if it does not fit the model."""
    x, r = ca.SX.sym("x", model.nx), ca.SX.sym("r", len(reference))
    given = controller(
        Named("state", [s.name for s in model.states], x), Named("reference", reference, r)
    )
    inputs = [s.name for s in model.inputs]
    if isinstance(given, Mapping):
        if set(given) != set(inputs):
            raise ModelError(
                f"the controller returns {', '.join(map(str, given))}; the inputs are "
                f"{', '.join(inputs)}"
            )
        given = [given[name] for name in inputs]
    rows = given if isinstance(given, list | tuple) else [given]
    try:
        u = ca.vertcat(*(ca.SX(row) for row in rows))
    except NotImplementedError:
        raise ModelError(
            "the controller returns something that is not a number or expression"
        ) from None
    if u.numel() != model.nu:
        raise ModelError(
            f"the controller returns {u.numel()} values for {model.nu} inputs: {', '.join(inputs)}"
        )
    return ca.Function("control", [x, r], [ca.densify(u)])


def _columns(reference: Mapping[str, ArrayLike]) -> Array:
    """References of all samples, (n, nr)."""
    columns = {name: as_numbers(v, f"reference '{name}'") for name, v in reference.items()}
    shapes = {name: c.shape for name, c in columns.items()}
    if not columns or len(set(shapes.values())) > 1 or any(c.ndim != 1 for c in columns.values()):
        raise DataError(f"the references must be columns of equal length, not {shapes}")
    R = np.column_stack(list(columns.values()))
    if len(R) == 0 or not np.isfinite(R).all():
        raise DataError("the references must be finite at every sample, and not empty")
    return R


def _recursion(model: Model, law: ca.Function, integrator: Integrator, dt: float) -> Recursion:
    """``(x, r, P) -> (x_next, x, u, y, z)``; P holds the parameters of all sub-steps."""
    m, n_par = integrator.steps, len(model.parameters)
    x, p, u = ca.SX.sym("x", model.nx), ca.SX.sym("p", n_par), ca.SX.sym("u", model.nu)
    x_next = integrator.substep(
        lambda xi, ui: model.f.call([xi, ui, p])[0], x, ua=u, ub=u, h=dt / m
    )
    substep = ca.Function("truth", [x, p, u], [x_next])
    still = [x, u, p, ca.SX.zeros(model.nx)]
    virtual = ca.SX(0, 1) if model.virtual is None else model.virtual.g.call(still)[0]
    measure = ca.Function("measure", [x, u, p], [*model.h.call([x, u, p]), virtual])
    X, r = ca.MX.sym("x", model.nx), ca.MX.sym("r", law.numel_in(1))
    P = ca.MX.sym("P", n_par * m)
    U = law.call([X, r])[0]
    columns = [ca.reshape(P, n_par, m)]
    (after,), _ = scan(substep, m, carry=[X], xs=columns, constants=[U])
    return Recursion(
        step=ca.Function("closed_loop", [X, r, P], [after, X, U, *measure(X, U, P[:n_par])]),
        carry0=np.zeros(model.nx),
        channels=tuple(map(Channel, ("x_true", "u", "y", "z_true"))),
        dt=dt,
    )


def _check_finite(X: Array, U: Array, dt: float) -> None:
    bad = ~(np.isfinite(X).all(axis=1) & np.isfinite(U).all(axis=1))
    if bad.any():
        raise DataError(
            f"the simulation is no longer finite at t = {np.argmax(bad) * dt:g} s: the loop is "
            "unstable; check the controller, the parameters and the number of sub-steps"
        )

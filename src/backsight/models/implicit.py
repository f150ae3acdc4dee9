"""Models with algebraic equations and implicit ones: F(dx/dt, x, z, u, p) = 0."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np
import scipy

from backsight.algebra.newton import newton
from backsight.errors import ModelError, nearest
from backsight.models.model import Model, Signals
from backsight.models.signals import Named, Signal, signals

Equations = Callable[..., Any]
"""To a list or dict of expressions."""


def implicit(
    residual: Equations,
    h: Equations,
    *,
    states: Signals,
    outputs: Signals,
    algebraic: Signals = (),
    inputs: Signals = (),
    parameters: Signals = (),
    guess: Callable[..., Mapping[str, object]] | None = None,
    dt: float | None = None,
    name: str = "model",
) -> Model:
    r"""Build a model from equations that are not solved for the rates.

    .. math:: F(\dot x, x, z, u, p) = 0, \qquad y = h(x, z, u, p)

    with as many equations as there are states x and algebraic variables z: massless nodes,
    constraints of forces, mass matrices that depend on the states. The rates and z are found by
    Newton's method where the model is evaluated, in every engine and in exported C, with exact
    derivatives, see `backsight.algebra.newton`. Estimates at which it has not converged have the
    status *not solved*.

    Parameters
    ----------
    residual : callable (xdot, x, z, u, p) -> list or dict
        Expressions that are zero; ``xdot.v`` is the rate of the state v (its next value, if `dt` is
        given).
    h : callable (x, z, u, p) -> list or dict
        Outputs.
    states, algebraic, outputs, inputs, parameters : dict
        Name to unit, value, ``(value, unit)`` or `Signal`. The value of an algebraic variable is
        the guess from which Newton's method starts.
    guess : callable (x, u, p) -> dict, optional
        Better guesses, by the names of algebraic variables or of states for their rates. Rates
        start from 0 if not given, next values from the present ones.
    dt, name
        As in `Model`.

    Raises
    ------
    ModelError
        If there are more or fewer equations than unknowns, or the equations do not determine one of
        them: its name is said (a constraint of positions must be differentiated until it holds the
        rates or forces, which is called index 1).

    Examples
    --------
    Two springs in series, a hardening one, with a massless node z between them:

    >>> from backsight.models.implicit import implicit
    >>> joint = implicit(
    ...     residual=lambda xdot, x, z, u, p: [
    ...         xdot.q - x.v,
    ...         2.0 * xdot.v + p.k2 * z.node - u.F,
    ...         1e4 * (x.q - z.node) + 5e7 * (x.q - z.node) ** 3 - p.k2 * z.node,
    ...     ],
    ...     h=lambda x, z, u, p: [x.q, z.node],
    ...     states={"q": "m", "v": "m/s"}, algebraic={"node": "m"}, inputs={"F": "N"},
    ...     outputs={"y": "m", "w": "m"}, parameters={"k2": (2e4, "N/m")},
    ... )
    >>> [round(float(v), 6) for v in joint.h([1e-3, 0.0], [0.0], [2e4]).full().ravel()]
    [0.001, 0.000334]
    """
    of_x, of_z = signals(states, "state"), signals(algebraic, "algebraic variable")
    of_u, of_p = signals(inputs, "input"), signals(parameters, "parameter")
    nx, names = len(of_x), [s.name for s in (*of_x, *of_z)]
    x, u, p = (ca.SX.sym(k, len(g)) for k, g in (("x", of_x), ("u", of_u), ("p", of_p)))
    given = (_named("state", of_x, x), _named("input", of_u, u), _named("parameter", of_p, p))

    def equations(w: ca.SX) -> ca.SX:
        rates, z = _named("rate of a state", of_x, w[:nx]), _named(ALGEBRAIC, of_z, w[nx:])
        return _stacked(residual(rates, given[0], z, *given[1:]), name)

    start = {s.name: x[i] if dt is not None else ca.SX(0) for i, s in enumerate(of_x)}
    start |= {s.name: ca.SX(s.value) for s in of_z}
    for key, value in (guess(*given) if guess else {}).items():
        if key not in start:
            raise ModelError(f"model '{name}': guess names '{key}', {nearest(key, start)}")
        start[key] = _stacked([value], name)
    called = [f"the rate of '{n}'" if i < nx else f"'{n}'" for i, n in enumerate(names)]
    check_determined(equations, called, f"model '{name}': the residual")
    root = newton(equations, ca.vertcat(*start.values()))
    arguments = [x, u, p]
    solve = ca.Function("solve", arguments, [root.w])

    def solved(*xup: Named) -> ca.SX:
        groups = zip(xup, (of_x, of_u, of_p), strict=True)
        return solve.call([ca.vertcat(*(v[s.name] for s in g)) for v, g in groups])[0]

    return Model(
        f=lambda *xup: ca.vertsplit(solved(*xup)[:nx]),
        h=lambda x, u, p: h(x, _named(ALGEBRAIC, of_z, solved(x, u, p)[nx:]), u, p),
        states=of_x,
        outputs=outputs,
        inputs=of_u,
        parameters=of_p,
        dt=dt,
        name=name,
        unsolved=ca.Function("unsolved", arguments, [root.left]),
    )


ALGEBRAIC = "algebraic variable"


def _named(kind: str, group: Sequence[Signal], vector: ca.SX) -> Named:
    return Named(kind, [s.name for s in group], vector)


def _stacked(returned: Any, name: str) -> ca.SX:
    rows = list(returned.values()) if isinstance(returned, Mapping) else returned
    try:
        return ca.vertcat(*(ca.SX(row) for row in rows))
    except (NotImplementedError, TypeError):
        raise ModelError(
            f"model '{name}': the residual, or a guess, returns something that is not a list of "
            "expressions"
        ) from None


def check_determined(
    equations: Callable[[ca.SX], ca.SX], called: Sequence[str], where: str
) -> None:
    """Raise `ModelError` unless every unknown can be found from an equation of its own."""
    w = ca.SX.sym("w", len(called))
    g = equations(w)
    if g.shape != w.shape:
        raise ModelError(
            f"{where} has {g.shape[0]} equations for {len(called)} unknowns: {', '.join(called)}"
        )
    pattern = np.array(ca.DM(ca.jacobian(g, w).sparsity(), 1)).astype(bool)
    owner = scipy.sparse.csgraph.maximum_bipartite_matching(
        scipy.sparse.csr_array(pattern), perm_type="row"
    )
    lost = [c for c, row in zip(called, owner, strict=True) if row < 0]
    if lost:
        raise ModelError(
            f"{where} leaves no equation to determine {', '.join(lost)}; a constraint that holds "
            "neither rates nor algebraic variables must be differentiated by time first (index 1)"
        )

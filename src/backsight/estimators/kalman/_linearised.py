"""The model along the estimates of a Kalman filter, for the way back of the smoother."""

from typing import Literal

import casadi as ca
import numpy as np

from backsight.algebra.factor import cholesky_semidefinite
from backsight.algebra.update import masked
from backsight.discrete.runge_kutta import Integrator
from backsight.engine.dense import product_of
from backsight.engine.loops import scan
from backsight.estimators.kalman.exact_sensors import exact_sensors, telling
from backsight.estimators.kalman.prediction import sensitivity
from backsight.estimators.kalman.square_root import noise_drowns, opened_factor
from backsight.estimators.parts.covariance import Covariance, matrix_product, transposed
from backsight.estimators.parts.factors import cholesky
from backsight.estimators.parts.filtering import Halves
from backsight.estimators.parts.leaf import Results, half, leaf, notation
from backsight.estimators.parts.linear import Linear, Varying, root, unstable
from backsight.estimators.parts.stages import measured_rows
from backsight.estimators.parts.substeps import seen_outputs, substep_inputs
from backsight.estimators.scaled import Setting
from backsight.estimators.smoothing import Linearised, blurred
from backsight.types import Array


def linear_looks(system: Linear | Varying, halves: Halves) -> Linearised:
    """Of a linear model: the same at every sample, unless its coefficients change."""
    s = system.s
    if isinstance(system, Varying):
        return _varying_looks(system)
    G = root(s.Q)
    noise = np.array(blurred(ca.DM(G))) if unstable(system.A) else G
    return _looks(s, halves, ahead=(system.A, noise), at="prior")


def _varying_looks(system: Varying) -> Linearised:
    s, nx = system.s, system.s.model.nx
    x, spread, u, u_next = _posterior(s, spread=Covariance(nx).size)
    F, _, noise = system.transitions(u, u_next)
    added = half("noise_kept", s, lambda noise: {"P": noise}, {"noise": (nx, nx)})(noise)
    ahead = [F, blurred(covariance_root(s)(added))]
    return Linearised(
        root=covariance_root(s),
        ahead=ca.Function("ahead", [x, spread, u, u_next], ahead),
        seen=seen(s, at="prior"),
        gathers="root",  # what drowns at one sample need not at another
    )


def ekf_looks(
    s: Setting, integrator: Integrator, halves: Halves, *, at: Literal["prior", "estimate"]
) -> Linearised:
    """Of an extended Kalman filter: transitions at its estimates, outputs `at` prior or estimate.

    The noise that a period adds is what the filter's own prediction makes of a state that is known.
    """
    nx = s.model.nx
    root_of = opened_factor(s) if exact_sensors(s) else covariance_root(s)
    x, spread, u, u_next = _posterior(s, spread=root_of.numel_in(0))
    if s.model.continuous:
        xs, held = substep_inputs(integrator, u, u_next)
        start = [x, ca.MX(ca.DM(np.eye(nx)))]
        step = sensitivity(s, integrator)
        (_, Ft), _ = scan(step, integrator.steps, carry=start, xs=xs, constants=held)
    else:
        Ft = _mapped(s)(x, u)
    known = ca.MX(ca.DM.zeros(spread.numel()))
    _, noise = halves.predict(x, known, u, u_next)
    ahead = [_turned(s)(Ft), blurred(root_of(noise))]
    function = ca.Function("ahead", [x, spread, u, u_next], ahead)
    return _looks(s, halves, ahead=function, at=at)


def _looks(
    s: Setting,
    halves: Halves,
    *,
    ahead: ca.Function | tuple[Array, Array],
    at: Literal["prior", "estimate"],
) -> Linearised:
    """How outputs are seen, and what is gathered on the way back."""
    if exact_sensors(s):
        rows = seen_exactly(s, halves.innovation, at=at)
        return Linearised(root=opened_factor(s), ahead=ahead, seen=rows, gathers="equations")
    gathers = "root" if noise_drowns(s) else "information"
    return Linearised(root=covariance_root(s), ahead=ahead, seen=seen(s, at=at), gathers=gathers)


def covariance_root(s: Setting) -> ca.Function:
    """Covariance, as the filter keeps it, to its lower factor."""
    return half("covariance_root", s, lambda P: {"L": ca.densify(cholesky(P))})


def seen(s: Setting, *, at: Literal["prior", "estimate"]) -> ca.Function:
    """See `Linearised.seen`; where the outputs are linearised."""
    if Covariance(s.model.nx).whole and not np.any(s.R - np.diag(np.diag(s.R))):
        return _seen_by_many(s, at=at)

    def formula(
        x_prior: ca.SX, spread_prior: ca.SX, x_post: ca.SX, u: ca.SX, y: ca.SX, mask: ca.SX
    ) -> Results:
        del spread_prior  # a derivative does not depend on it
        point = x_prior if at == "prior" else x_post
        H, e = measured_rows(s, point, u, y, mask)
        return {"Ht": ca.densify(H.T), "e": e + H @ (point - x_prior)}

    return leaf("seen", {**notation(s), "spread": Covariance(s.model.nx).size}, formula)


def seen_exactly(
    s: Setting, innovation: ca.Function, *, at: Literal["prior", "estimate"]
) -> ca.Function:
    """`seen` with sensors without noise: the rows (H', e, N) that tell something new."""

    def formula(x_prior: ca.SX, x_post: ca.SX, u: ca.SX, y: ca.SX, mask: ca.SX) -> Results:
        point = x_prior if at == "prior" else x_post
        output = s.model.output(point, u)
        H, e, R = masked(ca.jacobian(output, point), y - output, ca.SX(s.R), mask)
        noise = ca.densify(cholesky_semidefinite(R))
        return {"Ht": ca.densify(H.T), "e": e + H @ (point - x_prior), "noise": noise}

    rows = leaf("seen_exactly", notation(s), formula)
    names = ("x_prior", "spread", "x_post", "u", "y", "mask")
    sizes = (s.model.nx, innovation.numel_in(1), s.model.nx, s.model.nu, s.model.ny, s.model.ny)
    x_prior, spread, x_post, u, y, mask = given = [
        ca.MX.sym(k, n) for k, n in zip(names, sizes, strict=True)
    ]
    _, S = innovation(x_prior, spread, u, y, mask)
    new, _ = telling(s)(x_prior, S, u, mask)
    return ca.Function("seen", given, list(rows(x_prior, x_post, u, y, new)))


def _seen_by_many(s: Setting, *, at: Literal["prior", "estimate"]) -> ca.Function:
    """`seen` of many states, as operations on matrices; the noises of the outputs are independent.

    An expression for every entry of H would take minutes to compile.
    """
    nx, ny = s.model.nx, s.model.ny
    sizes = {
        "x_prior": nx, "spread": Covariance(nx).size, "x_post": nx, "u": s.model.nu, "y": ny,
        "mask": ny,
    }  # fmt: skip
    x_prior, _, x_post, u, y, mask = given = [ca.MX.sym(k, n) for k, n in sizes.items()]
    point = x_prior if at == "prior" else x_post
    expected, H = seen_outputs(s)(point, u)
    weight = mask / ca.DM(np.sqrt(np.diag(s.R)))
    Ht = transposed(ca.densify(H)) * product_of(ca.MX.ones(nx, 1), weight.T)
    e = weight * (y - expected) + matrix_product(transposed(Ht), point - x_prior)
    return ca.Function("seen", given, [Ht, e])


def _posterior(s: Setting, *, spread: int) -> list[ca.MX]:
    nx, nu = s.model.nx, s.model.nu
    sizes = {"x": nx, "spread": spread, "u": nu, "u_next": nu}
    return [ca.MX.sym(k, n) for k, n in sizes.items()]


def _mapped(s: Setting) -> ca.Function:
    """F' of a discrete-time model: ``(x, u) -> F'``."""

    def formula(x: ca.SX, u: ca.SX) -> Results:
        return {"Ft": ca.densify(ca.jacobian(s.model.rhs(x, u), x).T)}

    return leaf("mapped_derivative", notation(s), formula)


def _turned(s: Setting) -> ca.Function:
    nx = s.model.nx
    return half("turned", s, lambda Ft: {"Fm": transposed(Ft)}, {"Ft": (nx, nx)})

"""What the observer did in a window, linearised at the states that it passed."""

import dataclasses

import casadi as ca

from backsight.algebra.factor import solve_spd
from backsight.algebra.update import masked
from backsight.discrete.runge_kutta import Integrator
from backsight.engine.dense import all_entries, cholesky_of, scaled_rows, solve_triangular
from backsight.engine.loops import scan
from backsight.estimators.base import Setting
from backsight.estimators.kalman.prediction import (
    Propagation,
    moved_by,
    noise_between,
    per_sample,
)
from backsight.estimators.parts.covariance import (
    Covariance,
    Term,
    congruence,
    kalman_gain,
    matrix_product,
)
from backsight.estimators.parts.leaf import Results, half, leaf, notation
from backsight.estimators.parts.stages import noise_seen
from backsight.estimators.parts.substeps import seen_outputs, substep_inputs


@dataclasses.dataclass(frozen=True)
class Corrections:
    """Gains K of a filter, weighted outputs H, their noise R and R^-1 H; samples side by side."""

    K: ca.MX
    H: ca.MX
    noise: ca.MX
    weighted: ca.MX


@dataclasses.dataclass(frozen=True)
class LinearisedSteps:
    """What the observer did, linearised.

    Parameters
    ----------
    first : Corrections
        Of the pre-filter, at the first sample of the window.
    Phi, Q : MX
        Transition and process noise from each sample to the next, side by side.
    later : Corrections
        Of the post-filter, at the other samples.
    Sigma : MX
        Covariance of the optimiser, lower triangle.
    """

    first: Corrections
    Phi: ca.MX
    Q: ca.MX
    later: Corrections
    Sigma: ca.MX


def corrections(s: Setting) -> ca.Function:
    """``(x, P, u, mask) -> (K, H, noise, weighted)`` of a measurement update, see `Corrections`."""
    nx, ny = s.model.nx, s.model.ny

    def seen(x: ca.SX, u: ca.SX, mask: ca.SX) -> Results:
        H, _, R = masked(ca.jacobian(s.model.output(x, u), x), ca.SX.zeros(ny), ca.SX(s.R), mask)
        return {"H": ca.densify(H), "R": R, "weighted": ca.densify(solve_spd(R, H))}

    sizes = {**notation(s), "weighted": (ny, nx)}
    observed = leaf("observed", sizes, seen)
    opened = leaf("opened", sizes, lambda R: {"full": ca.densify(R)})

    def formula(x: Term, P: Term, u: Term, mask: Term) -> Results:
        H, vR, weighted = observed(x, u, mask)
        K, _ = kalman_gain(P, H, opened(vR))
        return {"K": K, "H": H, "noise": opened(vR), "weighted": weighted}

    def of_many(x: Term, P: Term, u: Term, mask: Term) -> Results:
        H = scaled_rows(all_entries(seen_outputs(s)(x, u)[1]), mask)
        R = noise_seen(s)(mask)
        L = cholesky_of(R)
        weighted = solve_triangular(L, solve_triangular(L, H), turned=True)
        return {"K": kalman_gain(P, H, R)[0], "H": H, "noise": R, "weighted": weighted}

    if Covariance(nx).whole:
        formula = of_many
    return half("corrections", s, formula, {"weighted": (ny, nx), "noise": (ny, ny)})


def variation(s: Setting, integrator: Integrator, propagation: Propagation) -> ca.Function:
    """``(x, u, u_next) -> (Phi, Q)``: transition to the next sample, and the noise on the way.

    The noise is that of `transition` of the extended Kalman filter, or once per sample.
    """
    nx, nu, kept = s.model.nx, s.model.nu, Covariance(s.model.nx)
    x, u, u_next = ca.MX.sym("x", nx), ca.MX.sym("u", nu), ca.MX.sym("u_next", nu)
    names = "variation", [x, u, u_next]
    if not s.model.continuous:

        def mapped(x: ca.SX, u: ca.SX) -> Results:
            return {"Phi": ca.densify(ca.jacobian(s.model.rhs(x, u), x))}

        walk = _with_walk(s)(ca.DM(kept.kept(0 * s.Q)), u)
        return ca.Function(*names, [leaf("mapped", notation(s), mapped)(x, u), walk])
    spread = propagation != "discrete" or integrator.scheme == "exact"
    noise = noise_between(s, integrator)
    step = moved_by(s, integrator)

    def formula(x: Term, Phi: Term, Q: Term, ua: Term, ub: Term) -> Results:
        x_next, F = step(x, ua, ub)
        before, after = noise(ua)
        return {
            "x_next": x_next,
            "Phi_next": ca.densify(matrix_product(F, Phi)),
            "Q_next": congruence(F, Q + before, after),
        }

    xs, held = substep_inputs(integrator, u, u_next)
    start = [x, ca.MX(ca.DM.eye(nx).full()), ca.MX(ca.DM(kept.kept(0 * s.Q)))]
    (_, Phi, Q), _ = scan(
        half("varied", s, formula), integrator.steps, carry=start, xs=xs, constants=held
    )
    whole = _with_walk(s)(Q, u) if spread else _with_walk(s.sampled())(start[2], u)
    return ca.Function(*names, [Phi, whole])


def _with_walk(s: Setting) -> ca.Function:
    """``(Q, u) -> Q`` with what is added once per sample."""
    return half("with_walk", s, lambda Q, u: {"Q_next": Q + per_sample(s, u)})

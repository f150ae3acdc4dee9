r"""The extended Kalman filter with a factor of its covariance, for priors far wider than the noise.

After a measurement that is a million times as exact as the prior, P holds variances of which one is
:math:`10^{12}` times the other, and after a prediction their sum: of the small one a few digits are
left, of one in :math:`10^{16}` none, and the covariance of two equal sensors is singular. With
:math:`P = L L'` nothing is ever added to a variance or subtracted from it: both halves compress an
array to its triangular factor,

.. math::
    \begin{bmatrix} R^{1/2} & H L \\ 0 & L \end{bmatrix} \to
    \begin{bmatrix} S^{1/2} & 0 \\ K S^{1/2} & L^+ \end{bmatrix}, \qquad
    \begin{bmatrix} \Phi L & Q^{1/2} \end{bmatrix} \to L^- ,

and numbers range over half as many decades. It takes about twice as long, so that it is for such
priors only. Source: Kailath, Sayed, Hassibi, "Linear Estimation", 2000, section 12.1; Simon,
"Optimal State Estimation", 2006, doi:10.1002/0470045345, section 6.3.
"""

import casadi as ca
import numpy as np

from backsight.algebra.factor import cholesky_semidefinite
from backsight.algebra.triangular import forward
from backsight.algebra.update import masked, measured, noise_of
from backsight.discrete.steps import over_sample
from backsight.engine.loops import scan
from backsight.errors import TuningError
from backsight.estimators.kalman.exact_sensors import exact_sensors
from backsight.estimators.kalman.prediction import moved_by, substep_noise
from backsight.estimators.parts.covariance import (
    Covariance,
    Term,
    times_transposed,
    transposed,
)
from backsight.estimators.parts.factors import Factor, cholesky_factor, compress_rows, on_top
from backsight.estimators.parts.filtering import Halves
from backsight.estimators.parts.flags import Flags
from backsight.estimators.parts.leaf import Results, half, leaf, notation
from backsight.estimators.parts.linear import root
from backsight.estimators.parts.substeps import (
    moved_state,
    seen_outputs,
    substep_inputs,
    within_bounds,
)
from backsight.estimators.scaled import Setting
from backsight.estimators.smoothing import drowned
from backsight.models.lti import output_equation, state_equation
from backsight.types import Array

WIDE = 1e6
"""Standard deviation of what a prior says of an output, by that of its noise, from which on the
covariance itself loses digits that matter."""


TOO_WIDE = 1e7
"""From here on a covariance gives wrong bands, of two equal sensors no numbers."""


def wide(s: Setting, *, limit: float = WIDE) -> bool:
    """Whether a prior is so wide, see `width_of_prior`, or a sensor has no noise at all."""
    return exact_sensors(s) or width_of_prior(s) > limit


def width_of_prior(s: Setting, linearised: tuple[Array, Array] | None = None) -> float:
    """Largest deviation of an output by the prior, in those of its noise; 0 if that runs away.

    At the start, or as many samples later as there are states: a state that no output shows at
    once, a velocity, is seen when it has moved. Matrices of transition and outputs are those at the
    prior's mean unless they are given.
    """
    F, H = linearised or _linearised(s)
    spread = cholesky_factor(s.P0)
    sigma, largest = np.sqrt(np.diag(s.R)), 0.0
    # What has no noise is no width: after it the state is known exactly, or not at all.
    H, sigma = H[sigma > 0], sigma[sigma > 0]
    for _ in range(min(s.model.nx, 10)):
        with np.errstate(over="ignore", invalid="ignore"):
            seen, H = np.linalg.norm(H @ spread, axis=1), H @ F
        if not np.isfinite(seen).all():
            return 0.0
        largest = max(largest, float((seen / sigma).max(initial=0.0)))
    return largest


def noise_drowns(s: Setting) -> bool:
    """Whether the way back of a smoother needs factors, see `drowned`; at the prior's mean."""
    F, H = _linearised(s)
    noise = cholesky_factor(s.R)
    if not (np.isfinite(F).all() and np.isfinite(H).all() and np.diag(noise).all()):
        return True
    white = np.asarray(np.linalg.solve(noise, H), float)
    return drowned(F, white, root(s.sampled().Q))


def refuse_too_wide(
    s: Setting, title: str, *, linearised: tuple[Array, Array] | None = None
) -> None:
    """Raise `TuningError` if the prior is too wide for a method that keeps a covariance.

    Matrices of transition and outputs are those at the prior's mean unless they are given.
    """
    if width_of_prior(s, linearised) > TOO_WIDE:
        raise TuningError(
            f"the prior says of an output more than {TOO_WIDE:g} times what its noise is: the "
            f"covariances of {title} cannot hold both; narrow the prior (sigma_x0), or use "
            "KalmanFilter, EKF, IEKF or UKF, which keep factors"
        )


def square_root_halves(s: Setting, *, ramp: ca.Function | None = None) -> Halves:
    """Measurement update and time update with a factor; the spread is that of `Factor`.

    Parameters
    ----------
    s : Setting
    ramp : casadi.Function, optional
        ``(x, u_next) -> x``: what an interpolated input adds to a linear model in discrete time.
    """
    kept = Factor(Covariance(s.model.nx))
    return Halves(
        spread_of=kept.spread,
        innovation=_innovation(s),
        correct=_correct(s),
        predict=_predict(s, ramp),
        covariance=covariance_of_factor(s),
        ramp=ramp is not None or s.integrator.hold == "foh",
    )


def _innovation(s: Setting) -> ca.Function:
    """``(x, spread, u, y, mask) -> (e, S)``, as of the extended Kalman filter."""
    kept = Factor(Covariance(s.model.nx))

    def seen(x: ca.SX, u: ca.SX, y: ca.SX, mask: ca.SX) -> Results:
        y_prior = s.model.output(x, u)
        e, noise = measured(mask) * (y - y_prior), noise_of(ca.SX(s.R), mask)
        return {"e": e, "H": ca.jacobian(y_prior, x), "noise": noise}

    expected = leaf("expected", notation(s), seen)

    def formula(x: Term, spread: Term, u: Term, y: Term, mask: Term) -> Results:
        e, H, R = expected(x, u, y, mask)
        HL = times_transposed(transposed(kept.opened(spread)), H)
        return {"e": e, "S": times_transposed(transposed(HL), transposed(HL)) + R}

    return half("innovation", s, formula, {"spread": kept.size})


def _correct(s: Setting) -> ca.Function:
    """Measurement update from one triangular factor: ``(x, spread, ...) -> (x, spread, flags)``."""
    nx, ny, kept = s.model.nx, s.model.ny, Factor(Covariance(s.model.nx))

    def rows(x: ca.SX, u: ca.SX, y: ca.SX, mask: ca.SX) -> Results:
        y_prior = s.model.output(x, u)
        H, e, R = masked(ca.jacobian(y_prior, x), y - y_prior, ca.SX(s.R), mask)
        return {"H": H, "e": e, "noise": ca.densify(cholesky_semidefinite(R))}

    def settled(x: ca.SX, KSy: ca.SX, Sy: ca.SX, e: ca.SX) -> Results:
        free = x + KSy @ forward(Sy, e)
        inside = within_bounds(s, free)
        clipped = ca.if_else(ca.norm_1(inside - free) > 0, 1, 0)
        return {"x_post": inside, "flags": Flags(clipped=clipped).vector()}

    sizes = {**notation(s), "KSy": (nx, ny), "Sy": (ny, ny)}
    seen, settle = leaf("seen", sizes, rows), leaf("settle", sizes, settled)

    def formula(x: Term, spread: Term, u: Term, y: Term, mask: Term) -> Results:
        L = kept.opened(spread)
        H, e, noise = seen(x, u, y, mask)
        HL = transposed(times_transposed(transposed(L), H))
        both = on_top([HL, L])
        array = ca.horzcat(on_top([noise, type(noise).zeros(nx, ny)]), both)
        joint = compress_rows(ca.densify(array))
        x_post, flags = settle(x, joint[ny:, :ny], joint[:ny, :ny], e)
        return {
            "x_post": x_post,
            "spread_post": ca.vertcat(kept.closed(joint[ny:, ny:]), 0),
            "flags": flags,
        }

    return half("correct", s, formula, {"spread": kept.size})


def _predict(s: Setting, ramp: ca.Function | None) -> ca.Function:
    """Time update over one sampling period: ``(x, spread, u, u_next) -> (x, spread)``."""
    nx, nu, kept = s.model.nx, s.model.nu, Factor(Covariance(s.model.nx))
    n = s.integrator.steps if s.model.continuous else 1
    moved = moved_by(s, s.integrator)
    if s.parts:
        raise TuningError("noise that inputs multiply goes with narrower priors only")
    before, after = (cholesky_factor(Q) for Q in substep_noise(s, s.integrator))
    noisy, sizes = before.any() or after.any(), {"spread": kept.size}

    def step(x: Term, spread: Term, ua: Term, ub: Term) -> Results:
        x_next, Phi = moved(x, ua, ub)
        L = kept.opened(spread)
        if before.any():
            L = ca.horzcat(L, type(L)(ca.DM(before)))
        L = transposed(times_transposed(transposed(L), Phi))
        if noisy:
            L = ca.horzcat(L, type(L)(ca.DM(after)))
        L_next = kept.closed(compress_rows(ca.densify(L)))
        return {"x_next": x_next, "spread_next": ca.vertcat(L_next, 0)}

    x, spread = ca.MX.sym("x", nx), ca.MX.sym("spread", kept.size)
    u, u_next = ca.MX.sym("u", nu), ca.MX.sym("u_next", nu)
    xs, held = substep_inputs(s.integrator, u, u_next) if s.model.continuous else ([], [u, u])
    go = half("square_root_step", s, step, sizes)
    (x_end, end), _ = scan(go, n, carry=[x, spread], xs=xs, constants=held)
    if s.Q.any():
        walk = cholesky_factor(s.Q)

        def walked(spread: Term) -> Results:
            L = kept.opened(spread)
            L = compress_rows(ca.densify(ca.horzcat(L, type(L)(ca.DM(walk)))))
            return {"spread_next": ca.vertcat(kept.closed(L), 0)}

        end = half("walked", s, walked, sizes)(end)
    if ramp is not None:
        x_end = ramp(x_end, u_next)
    return ca.Function("predict", [x, spread, u, u_next], [x_end, end])


def opened_factor(s: Setting) -> ca.Function:
    """Spread to the lower factor (nx, nx)."""
    kept = Factor(Covariance(s.model.nx))
    sizes = {"spread": kept.size}
    return half("opened", s, lambda spread: {"L": ca.densify(kept.opened(spread))}, sizes)


def covariance_of_factor(s: Setting) -> ca.Function:
    """Spread of `Factor` to the lower triangle of the covariance."""
    kept = Factor(Covariance(s.model.nx))

    def formula(spread: Term) -> Results:
        L = kept.opened(spread)
        return {"P": times_transposed(L, L)}

    whole = half("factor_product", s, formula, {"spread": kept.size})
    spread = ca.MX.sym("spread", kept.size)
    return ca.Function("covariance", [spread], [kept.like.triangle()(whole(spread))])


def _linearised(s: Setting) -> tuple[Array, Array]:
    """Transition matrix (nx, nx) and output matrix (ny, nx) at the prior's mean, without input."""
    if Covariance(s.model.nx).whole:
        # One sub-step stands for a sample: how far the prior is wider than the noise matters.
        still = np.zeros(s.model.nu)
        _, F = moved_state(s, s.integrator)(s.x0, still, still)
        _, H = seen_outputs(s)(s.x0, still)
        steps = s.integrator.steps if s.model.continuous else 1
        return np.linalg.matrix_power(ca.densify(F).full(), steps), ca.densify(H).full()
    if not s.model.continuous:
        states, outputs = state_equation(s.model), output_equation(s.model)
        if states and outputs:
            return states[0], outputs[0]
    x, u = ca.SX.sym("x", s.model.nx), ca.SX.sym("u", s.model.nu)
    still = np.zeros(s.model.nu)
    slope = ca.Function("H", [x, u], [ca.densify(ca.jacobian(s.model.output(x, u), x))])
    _, F, _ = over_sample(s.integrator, s.model, s.dt)(s.x0, still, still)
    return np.array(F), np.array(slope(s.x0, still))

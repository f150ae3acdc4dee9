r"""Covariance of the moving horizon observer, whatever the weight of its measurements.

A measurement counts several times: at every sample while it is in the window, in the cost and in
both filters. Everything is linear in the errors, so that the error of an estimate is

.. math:: \hat x - x = \varepsilon + \sum_i (V_i v_i + W_i w_i)

with the noise of the samples of the window and what has nothing to do with them, and it is enough
to know V, W and the covariance of :math:`\varepsilon` at the start of the window. The gains are
those that the observer has; none of them has to be optimal.
"""

import dataclasses

import casadi as ca
import numpy as np

from backsight.engine.dense import add_product
from backsight.engine.loops import scan
from backsight.estimators.mho._linearised import LinearisedSteps
from backsight.estimators.parts.covariance import Covariance, Term, transposed
from backsight.estimators.parts.leaf import Results, Symmetric, half
from backsight.estimators.scaled import Setting
from backsight.estimators.varied_number import varied_at
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class Errors:
    """Error at the start of a window.

    Parameters
    ----------
    P : MX
        Covariance of what is independent of the noise in the window, as it is kept.
    V : MX
        Influence of the sensors' noise, (nx, ny N) for the samples 0 ... N - 1.
    W : MX
        Influence of the process noise, (nx, nx (N - 1)) for the steps from 0 ... N - 2.
    """

    P: ca.MX
    V: ca.MX
    W: ca.MX


def no_errors(s: Setting, N: int) -> dict[str, Array]:
    """Memory before the first window: nothing depends on its noise."""
    nx, ny = s.model.nx, s.model.ny
    return {
        "P_alone": Covariance(nx).kept(s.P0),
        "by_v": np.zeros((nx, ny * N)),
        "by_w": np.zeros((nx, nx * (N - 1))),
    }


def true_covariance(
    s: Setting, errors: Errors, steps: LinearisedSteps, u: ca.MX, *, N: int, alpha: float
) -> tuple[ca.MX, Errors]:
    """Covariance of the estimate at the end of the window, and the errors of the next start.

    u are the inputs of a sample of the window; only those that are settings matter.
    """
    nx, ny = s.model.nx, s.model.ny
    first, later, Phi, Q = steps.first, steps.later, steps.Phi, steps.Q
    eye, none = ca.MX(ca.DM.eye(nx).full()), ca.MX.zeros(nx, nx)

    # 1. gains of the optimiser, L_i = alpha Sigma Phi_i0' H_i' R_i^-1
    Sigma = Covariance(nx).of_triangle()(steps.Sigma)
    gain = _gain(s, alpha)
    _, L0 = gain(eye, eye, first.weighted, Sigma, u)
    _, (L,) = scan(gain, N, carry=[eye], xs=[Phi, later.weighted], constants=[Sigma, u])

    # 2. what process noise adds to the residuals: M_j = sum of L_i H_i Phi_i,j+1 over i > j
    (ahead,), (M,) = scan(_residuals(s), N, carry=[none], xs=[L, later.H, Phi], backward=True)

    # 3. error of the optimum
    A, P0 = _pre_filtered(s)(ahead, L0, first.K, first.H, first.noise, errors.V[:, :ny], errors.P)
    V_before = ca.horzcat(errors.V[:, ny:], ca.MX.zeros(nx, ny))
    W_before = ca.horzcat(errors.W, none)
    columns = [V_before, W_before, L, M, later.noise, Q]
    (P,), (V, W) = scan(_optimum(s), N, carry=[P0], xs=columns, constants=[A])

    # 4. post-filter: the noise of its samples may be in the estimate already
    columns = [Phi, Q, later.K, later.H, later.noise, V, W]
    (P_now, _), _ = scan(_filtered(s), N, carry=[P, eye], xs=columns)

    # 5. start of the next window
    P_next = _left(s)(P0, W[:, :nx], Phi[:, :nx], Q[:, 0])
    _, (V_next,) = scan(_moved(s, ny), N, carry=[], xs=[V], constants=[Phi[:, :nx]])
    W_next = ca.MX.zeros(nx, 0)
    if N > 1:
        rest = W[:, nx:]
        _, (W_next,) = scan(_moved(s, nx), N - 1, carry=[], xs=[rest], constants=[Phi[:, :nx]])
    return P_now, Errors(P_next, V_next, W_next)


def _times(A: Term, B: Term) -> Term:
    """A B of dense matrices."""
    if isinstance(A, ca.MX):
        return add_product(ca.MX.zeros(A.shape[0], B.shape[1]), A, transposed(B))
    return A @ B


def _plus_transposed(A: Term) -> Term:
    return A + transposed(A)


def _sizes(s: Setting) -> dict[str, int | tuple[int, int] | Symmetric]:
    nx, ny = s.model.nx, s.model.ny
    square, tall = (nx, nx), (nx, ny)
    return {"T": square, "A": square, "M": square, "W": square, "V": tall, "L": tall} | {
        "weighted": (ny, nx),
        "noise": (ny, ny),
        "Sigma": Symmetric(nx),
    }


def _gain(s: Setting, alpha: float) -> ca.Function:
    """``(T, Phi, weighted, Sigma, u) -> (T, L)``: transition from the start, gain of a sample."""

    def formula(T: Term, Phi: Term, weighted: Term, Sigma: Term, u: Term) -> Results:
        T_next = _times(Phi, T)
        L = varied_at(alpha, u) * _times(Sigma, transposed(_times(weighted, T_next)))
        return {"T_next": T_next, "L": L}

    return half("optimiser_gain", s, formula, _sizes(s))


def _residuals(s: Setting) -> ca.Function:
    """``(A, L, H, Phi) -> (A, M)``: what the error of a sample, and the noise up to it, change."""

    def formula(A: Term, L: Term, H: Term, Phi: Term) -> Results:
        M = _times(L, H) + A
        return {"A_next": _times(M, Phi), "M": M}

    return half("residuals", s, formula, _sizes(s))


def _pre_filtered(s: Setting) -> ca.Function:
    """``(A, L, K, H, noise, V, P) -> (A, P)``: from the start of the window to the optimum."""
    eye = np.eye(s.model.nx)

    def formula(A: Term, L: Term, K: Term, H: Term, noise: Term, V: Term, P: Term) -> Results:
        optimised = eye - A - _times(L, H)
        A_next = _times(optimised, eye - _times(K, H))
        influence = _times(A_next, V) + L + _times(optimised, K)
        P_next = _spread(A_next, P) + _spread(influence, noise)
        return {"A_next": A_next, "P_next": P_next}

    return half("pre_filtered", s, formula, _sizes(s))


def _optimum(s: Setting) -> ca.Function:
    """``(P, V, W, L, M, noise, Q, A) -> (P, V, W)`` of a sample and the step to it."""

    def formula(
        P: Term, V: Term, W: Term, L: Term, M: Term, noise: Term, Q: Term, A: Term
    ) -> Results:
        V_next, W_next = _times(A, V) + L, _times(A, W) + M
        P_next = P + _spread(V_next, noise) + _spread(W_next, Q)
        return {"P_next": P_next, "V_next": V_next, "W_next": W_next}

    return half("optimum", s, formula, _sizes(s))


def _filtered(s: Setting) -> ca.Function:
    """``(P, T, Phi, Q, K, H, noise, V, W) -> (P, T)``: covariance, and influence of the optimum."""

    def formula(
        P: Term,
        T: Term,
        Phi: Term,
        Q: Term,
        K: Term,
        H: Term,
        noise: Term,
        V: Term,
        W: Term,
    ) -> Results:
        T_prior = _times(Phi, T)
        known = _times(_times(T_prior, W), Q)
        P_prior = _spread(Phi, P) + Q - _plus_transposed(known)
        rest = np.eye(s.model.nx) - _times(K, H)
        seen = _times(_times(_times(rest, _times(T_prior, V)), noise), transposed(K))
        P_post = _spread(rest, P_prior) + _spread(K, noise) + _plus_transposed(seen)
        return {"P_post": P_post, "T_post": _times(rest, T_prior)}

    return half("post_filtered", s, formula, _sizes(s))


def _left(s: Setting) -> ca.Function:
    """``(P, W, Phi, Q) -> P`` one sample later, with the noise that leaves the window."""

    def formula(P: Term, W: Term, Phi: Term, Q: Term) -> Results:
        known = _times(_times(Phi, W), Q)
        whole = _spread(Phi, P + _spread(W, Q))
        return {"P_next": whole + Q - _plus_transposed(known)}

    return half("left", s, formula, _sizes(s))


def _moved(s: Setting, columns: int) -> ca.Function:
    """``(X, Phi) -> Phi X``."""
    return half(
        "moved_on",
        s,
        lambda X, Phi: {"X_next": _times(Phi, X)},
        {"X": (s.model.nx, columns)},
    )


def _spread(F: Term, P: Term) -> Term:
    """F P F' of a dense F."""
    return _times(_times(F, P), transposed(F))

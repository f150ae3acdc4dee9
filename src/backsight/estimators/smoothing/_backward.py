"""A sample of the way back, by what it gathers of the measurements ahead."""

import dataclasses
from typing import Literal

import casadi as ca
import numpy as np

from backsight.estimators.parts.covariance import (
    Covariance,
    Term,
    congruence,
    matrix_product,
    transposed,
)
from backsight.estimators.parts.factors import on_top
from backsight.estimators.parts.leaf import Results, Symmetric, half
from backsight.estimators.scaled import Setting
from backsight.estimators.smoothing._equations import estimated, joined, through_noise
from backsight.estimators.smoothing.information import carried_back, combined_with, noise_passed
from backsight.estimators.smoothing.two_filter import combined, gathered, weakened
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class Linearised:
    """The model as a filter saw it at a sample; matrices dense.

    Parameters
    ----------
    root : casadi.Function
        ``spread -> L``, the lower factor of the covariance.
    ahead : casadi.Function, or (F, G)
        ``(x, spread, u, u_next) -> (F, G)`` of a posterior: how deviations go to the next sample,
        and a factor of the covariance of what is added there; or both, if they are constant.
    seen : casadi.Function
        ``(x_prior, spread_prior, x_post, u, y, mask) -> (H', e)``: deviations from the prior as the
        outputs show them, in units of the noise, and the residual at the prior. For *equations* it
        is ``(H', e, N)``, in any units, with the factor of the noise.
    gathers : {"information", "root", "equations"}
        What the way back gathers: the information, its root where process noise drowns it, see
        `information.drowned`, or equations where sensors have no noise, see `_equations`.
    """

    root: ca.Function
    ahead: ca.Function | tuple[Array, Array]
    seen: ca.Function
    gathers: Literal["information", "root", "equations"]

    @property
    def sees_spread(self) -> bool:
        """Whether `seen` depends on the spread of the prior."""
        rows = range(self.seen.n_out())
        return any(self.seen.jac_sparsity(k, 1).nnz() for k in rows)

    @property
    def constant(self) -> tuple[Array, Array] | None:
        """F and G, if they are the same at every sample."""
        return self.ahead if isinstance(self.ahead, tuple) else None

    @property
    def noises(self) -> int:
        """Columns of G."""
        return self.ahead[1].shape[1] if isinstance(self.ahead, tuple) else self.ahead.size2_out(1)


def way_back(s: Setting, linearised: Linearised) -> tuple[dict[str, Array], ca.Function]:
    """What the way back gathers, before the last sample: nothing; and how a sample adds to it."""
    nx = s.model.nx
    match linearised.gathers:
        case "information":
            start = {"J": np.zeros(Covariance(nx).size), "eta": np.zeros(nx)}
            return start, _back(s, linearised)
        case "root":
            return {"U": np.zeros((nx, nx)), "zeta": np.zeros(nx)}, _back_by_root(s, linearised)
        case "equations":
            start = {"A": np.zeros((nx, nx)), "N": np.eye(nx), "zeta": np.zeros(nx)}
            return start, _back_by_equations(s, linearised)


def _back(s: Setting, seen: Linearised) -> ca.Function:
    """One sample back, see `information`: what is told ahead, and the smoothed estimate.

    ``(J, eta, x_prior, x_post, L, H', e, *matrices) -> (J, eta, x, T')``; the matrices are F and G
    unless they are the same at every sample.
    """
    nx, ny, q = s.model.nx, s.model.ny, seen.noises
    sizes = {
        "J": Symmetric(nx), "eta": nx, "F": (nx, nx), "G": (nx, q), "Ht": (nx, ny), "L": (nx, nx),
        "Tt": (nx, nx),
    }  # fmt: skip

    def moved(
        J: Term, eta: Term, x_prior: Term, x_post: Term, L: Term, Ht: Term, e: Term,
        F: Term | ca.DM, G: Term | ca.DM,
    ) -> Results:  # fmt: skip
        # 1. What the samples ahead tell of the state after this one's measurement.
        J, eta = carried_back(*noise_passed(J, eta, G), F)
        # 2. The smoothed estimate.
        x, Tt = combined_with(x_post, L, J, eta)
        # 3. Together with this sample's measurement, as deviations from its prior.
        told = eta + matrix_product(J, x_post - x_prior) + matrix_product(Ht, e)
        return {"J": congruence(Ht, type(J)(ca.DM(np.eye(ny))), J), "eta": told, "x": x, "Tt": Tt}

    if seen.constant is None:
        return half("smoothed_sample", s, moved, sizes)
    F, G = (ca.sparsify(ca.DM(k)) for k in seen.constant)

    def fixed(
        J: Term, eta: Term, x_prior: Term, x_post: Term, L: Term, Ht: Term, e: Term
    ) -> Results:
        return moved(J, eta, x_prior, x_post, L, Ht, e, F, G)

    return half("smoothed_sample", s, fixed, sizes)


def _back_by_root(s: Setting, seen: Linearised) -> ca.Function:
    """One sample back with the root of the information, see `two_filter`, else as `_back`."""
    nx, ny, q = s.model.nx, s.model.ny, seen.noises
    sizes = {
        "U": (nx, nx), "zeta": nx, "F": (nx, nx), "G": (nx, q), "Ht": (nx, ny), "L": (nx, nx),
        "Tt": (nx, nx),
    }  # fmt: skip

    def moved(
        U: Term, zeta: Term, x_prior: Term, x_post: Term, L: Term, Ht: Term, e: Term,
        F: Term, G: Term,
    ) -> Results:  # fmt: skip
        Vt, told = weakened(U, zeta, G)
        Vt = matrix_product(Vt, F)
        x, Tt = combined(x_post, L, Vt, told)
        right = told + matrix_product(Vt, x_post - x_prior)
        below = ca.horzcat(transposed(right), transposed(e))
        all_told = gathered(on_top([ca.horzcat(transposed(Vt), Ht), below]))
        return {
            "U": ca.densify(all_told[:nx, :nx]),
            "zeta": ca.densify(transposed(all_told[nx, :nx])),
            "x": x,
            "Tt": ca.densify(Tt),
        }

    if seen.constant is None:
        return half("smoothed_sample", s, moved, sizes)
    F, G = map(ca.DM, seen.constant)

    def fixed(
        U: Term, zeta: Term, x_prior: Term, x_post: Term, L: Term, Ht: Term, e: Term
    ) -> Results:
        kind = type(U)
        return moved(U, zeta, x_prior, x_post, L, Ht, e, kind(F), kind(G))

    return half("smoothed_sample", s, fixed, sizes)


def _back_by_equations(s: Setting, seen: Linearised) -> ca.Function:
    """One sample back with equations, see `_equations`, else as `_back`.

    ``(A, N, zeta, x_prior, x_post, L, H', e, noise, *matrices) -> (A, N, zeta, x, T')``.
    """
    nx, ny, q = s.model.nx, s.model.ny, seen.noises
    sizes = {
        "A": (nx, nx), "N": (nx, nx), "zeta": nx, "F": (nx, nx), "G": (nx, q), "Ht": (nx, ny),
        "noise": (ny, ny), "L": (nx, nx), "Tt": (nx, nx),
    }  # fmt: skip

    def moved(
        A: Term, N: Term, zeta: Term, x_prior: Term, x_post: Term, L: Term, Ht: Term, e: Term,
        noise: Term, F: Term, G: Term,
    ) -> Results:  # fmt: skip
        # 1. What the samples ahead tell of the state after this one's measurement.
        N, A = through_noise(A, N, G), matrix_product(A, F)
        # 2. The smoothed estimate.
        x, Tt = estimated(x_post, L, A, N, zeta)
        # 3. Together with this sample's measurement, as deviations from its prior.
        zeta = zeta + matrix_product(A, x_post - x_prior)
        A, N, zeta = joined(A, N, zeta, H=transposed(Ht), noise=noise, e=e)
        return {"A": A, "N": N, "zeta": zeta, "x": x, "Tt": Tt}

    if seen.constant is None:
        return half("smoothed_sample", s, moved, sizes)
    F, G = map(ca.DM, seen.constant)

    def fixed(
        A: Term, N: Term, zeta: Term, x_prior: Term, x_post: Term, L: Term, Ht: Term, e: Term,
        noise: Term,
    ) -> Results:  # fmt: skip
        kind = type(A)
        return moved(A, N, zeta, x_prior, x_post, L, Ht, e, noise, kind(F), kind(G))

    return half("smoothed_sample", s, fixed, sizes)

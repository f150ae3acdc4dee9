r"""The model along the estimates of an unscented Kalman filter, for the way back of the smoother.

Sigma points are :math:`x + L \xi_i`. Their images have the regression :math:`M \xi` on
:math:`\xi`, and what is left of their scatter is noise: with the images :math:`a_j, b_j` of a pair
of points, as deviations from their mean, M has the columns :math:`w s (a_j - b_j)`, and

.. math:: \sum_i w_i d_i d_i' - M M' = w_0 d_0 d_0' + \tfrac12 \sum_j w (a_j + b_j)(a_j + b_j)'

without a difference, since :math:`2 w s^2 = 1`. With :math:`F = M L^{-1}` the smoother of this
linear model is the unscented one.

Source: Särkkä, "Unscented Rauch-Tung-Striebel smoother", 2008, doi:10.1109/TAC.2008.919531.
"""

import casadi as ca
import numpy as np

from backsight.algebra.factor import cholesky_semidefinite
from backsight.algebra.sigma import Weights
from backsight.algebra.update import masked
from backsight.engine.dense import UNROLL
from backsight.errors import TuningError
from backsight.estimators.kalman.exact_sensors import exact_sensors, telling
from backsight.estimators.kalman.square_root import noise_drowns
from backsight.estimators.parts.covariance import Covariance, Term, transposed
from backsight.estimators.parts.factors import (
    deviation_factor,
    mean_and_deviations,
    solve_lower,
    solve_upper_semidefinite,
)
from backsight.estimators.parts.leaf import Results, half, leaf, notation
from backsight.estimators.scaled import Setting
from backsight.estimators.smoothing import Linearised, blurred
from backsight.types import Array


def unscented_looks(
    s: Setting,
    w: Weights,
    *,
    opened: ca.Function,
    moved: ca.Function,
    shown: ca.Function,
    innovation: ca.Function,
    Q: Array,
) -> Linearised:
    """Of an unscented Kalman filter.

    Parameters
    ----------
    s : Setting
    w : Weights
    opened : casadi.Function
        What the filter keeps of a covariance to its lower factor.
    moved : casadi.Function
        ``(x, spread, u, u_next) -> X``: sigma points one sample later.
    shown : casadi.Function
        ``(x, spread, u) -> Y``: outputs at the sigma points.
    innovation : casadi.Function
        ``(x, spread, u, y, mask) -> (e, S)`` of the filter.
    Q : (nx, nx) array
        Factor of the process noise that is added per sample.
    """
    nx, ny, count, exact = s.model.nx, s.model.ny, len(w.mean), exact_sensors(s)
    if exact:
        _refuse_many_states(s)
    sizes = {
        "X": (nx, count), "Y": (ny, count), "L": (nx, nx), "Ht": (nx, ny), "Fm": (nx, nx),
        "noise": (ny, ny), "factor": (nx, 2 * nx),
    }  # fmt: skip

    def ahead(X: Term, L: Term) -> Results:
        Ft, G = regression(X, w, type(X)(ca.DM(Q)), L)
        return {"Fm": transposed(Ft), "factor": blurred(G)}

    def weighed(Y: ca.SX, y: ca.SX, mask: ca.SX) -> Results:
        mean, _ = mean_and_deviations(Y, w)
        Y, e, R = masked(Y, y - mean, ca.SX(s.R), mask)
        return {"Y_seen": ca.densify(Y), "e": e, "noise": ca.densify(cholesky_semidefinite(R))}

    def seen(Y: Term, e: Term, noise: Term, L: Term) -> Results:
        Ht, scatter = regression(Y, w, noise, L)
        if exact:
            return {"Ht": Ht, "e_seen": e, "noise_seen": scatter}
        white = solve_lower(scatter, transposed(Ht))
        return {"Ht": transposed(white), "e_white": solve_lower(scatter, e)}

    spread = ca.MX.sym("spread", opened.numel_in(0))
    given = {k: ca.MX.sym(k, n) for k, n in (("x", nx), ("u", s.model.nu), ("u_next", s.model.nu))}
    x, u, u_next = given.values()
    images = moved(x, spread, u, u_next)
    on = half("unscented_ahead", s, ahead, sizes)(images, opened(spread))
    y, mask, x_post = ca.MX.sym("y", ny), ca.MX.sym("mask", ny), ca.MX.sym("x_post", nx)
    if exact:  # rows that tell something new
        mask_seen, _ = telling(s)(x, innovation(x, spread, u, y, mask)[1], u, mask)
    else:
        mask_seen = mask
    rows = leaf("unscented_rows", {**notation(s), **sizes}, weighed)(
        shown(x, spread, u), y, mask_seen
    )
    looked = half("unscented_seen", s, seen, sizes)(*rows, opened(spread))
    return Linearised(
        root=opened,
        gathers="equations" if exact else "root" if noise_drowns(s) else "information",
        ahead=ca.Function("ahead", [x, spread, u, u_next], list(on)),
        seen=ca.Function("seen", [x, spread, x_post, u, y, mask], list(looked)),
    )


def _refuse_many_states(s: Setting) -> None:
    """Raise `TuningError` where slopes along what is known exactly would be divided by rounding."""
    if Covariance(s.model.nx).whole:
        raise TuningError(
            f"the model has {s.model.nx} states, and sensors have no noise (sigma_y = 0, a "
            "singular R): sigma points have no slope along what such a sensor has told, and with "
            f"more than {UNROLL} states UKF cannot tell these directions from rounding; smooth "
            "with EKF or IEKF, or give the sensors a small sigma_y"
        )


def regression(images: Term, w: Weights, noise: Term, L: Term) -> tuple[Term, Term]:
    """Transposed slope (n, m) of images (m, 2 n + 1) on their points, and a factor of the rest.

    Parameters
    ----------
    images : (m, 2 n + 1)
        Of sigma points around a mean with the factor L (n, n), in order.
    w : Weights
    noise : (m, k)
        Factor of the noise that is added to the images.
    """
    n = L.shape[0]
    _, d = mean_and_deviations(images, w)
    a, b = d[:, 1 : n + 1], d[:, n + 1 :]
    M = float(w.covariance[1] * w.spread) * (a - b)
    rest = ca.horzcat(d[:, 0], (a + b) / np.sqrt(2), type(d).zeros(d.shape[0], n))
    factor, _ = deviation_factor(rest, w, noise)
    return solve_upper_semidefinite(L, transposed(M)), factor

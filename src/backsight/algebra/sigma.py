"""Sigma points of the scaled unscented transform."""

import dataclasses

import casadi as ca
import numpy as np

from backsight.algebra.triangular import compress, downdate
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class Weights:
    r"""Spread and weights of 2 n + 1 sigma points.

    With :math:`\lambda = \alpha^2 (n + \kappa) - n` the points are the mean and the mean plus and
    minus :math:`\sqrt{n + \lambda}` times the columns of the factor.

    Parameters
    ----------
    spread : float
    mean, covariance : (2 n + 1,) arrays
        Only the first weight of the covariance may be negative.

    Source: Julier, "The scaled unscented transformation", 2002, doi:10.1109/ACC.2002.1025369;
    Wan and van der Merwe, 2000, doi:10.1109/ASSPCC.2000.882463.
    """

    spread: float
    mean: Array
    covariance: Array


def weights(n: int, *, alpha: float, beta: float, kappa: float) -> Weights:
    """Weights for n states; alpha, beta and kappa are the usual three."""
    total = alpha**2 * (n + kappa)
    mean = np.full(2 * n + 1, 0.5 / total)
    mean[0] = 1.0 - n / total
    covariance = mean.copy()
    covariance[0] += 1.0 - alpha**2 + beta
    return Weights(spread=float(np.sqrt(total)), mean=mean, covariance=covariance)


def sigma_points(x: ca.SX, L: ca.SX, spread: float) -> ca.SX:
    """Points side by side, (n, 2 n + 1), of mean x (n,) and lower factor L (n, n)."""
    columns = ca.repmat(x, 1, x.numel())
    return ca.horzcat(x, columns + spread * L, columns - spread * L)


def factor(deviations: ca.SX, w: Weights, noise: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Factor of the covariance of weighted deviations plus noise, and 1 if it is definite.

    Parameters
    ----------
    deviations : (n, 2 n + 1)
        Points minus mean.
    w : Weights
    noise : (n, k)
        Factor of the covariance that is added.
    """
    centre = float(w.covariance[0])
    root = np.sqrt(w.covariance[1:])
    spread = deviations[:, 1:] @ ca.diag(ca.SX(root))
    if centre >= 0:
        return compress(ca.horzcat(np.sqrt(centre) * deviations[:, 0], spread, noise)), ca.SX(1)
    return downdate(compress(ca.horzcat(spread, noise)), np.sqrt(-centre) * deviations[:, 0])

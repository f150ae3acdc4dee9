r"""What the modes that are left out do: their deflection under forces that do not change.

With all modes :math:`w = \sum_i \varphi_i \varphi_i' f / \lambda_i` for a static force; of the kept
ones only the first terms are in the model. The rest is found without the other modes: it is the
static deflection under :math:`f - M \Phi \Phi' f`, the force that moves no kept mode, so that it is
defined for a free structure, too.

Source: Craig, Kurdila, "Fundamentals of Structural Dynamics", 2nd ed. 2006, sections 11.4 and 17.5
(residual flexibility, inertia relief).
"""

import numpy as np

from backsight.errors import ModelError
from backsight.models.structures.matrices.lowest_modes import LowestModes
from backsight.types import Array, Sparse

_CONVERGED = 1e-13
_MOST = 500

_MASSLESS = 1e-24
"""A residual shape whose mass is this share of what its stiffness suggests has none: its motion
follows the force at once."""


def residual(M: Sparse, modes: LowestModes, loads: Array) -> Array:
    r"""Static deflection of the modes that are not kept, (n, k), under loads (n, k).

    :math:`K r = f - M \Phi \Phi' f` by the factors of :math:`K - \sigma M` that are there:
    :math:`(K - \sigma M) r_{i+1} = f - M \Phi \Phi' f - \sigma M r_i`, which converges by
    :math:`|\sigma| / (\lambda + |\sigma|)`, with the lowest :math:`\lambda` that is left out.
    """
    Phi = modes.shapes
    left = loads - M @ (Phi @ (Phi.T @ loads))
    r = np.zeros_like(left)
    for _ in range(_MOST):
        last, r = r, modes.solve(left - modes.shift * (M @ r))
        r = r - Phi @ (Phi.T @ (M @ r))
        if np.abs(r - last).max() <= _CONVERGED * max(np.abs(r).max(), 1e-300):
            return r
    raise ModelError(
        "the static deflection of the modes that are left out could not be found: a mode that is "
        "left out has hardly any stiffness; keep more modes"
    )


def static(M: Sparse, modes: LowestModes, loads: Array) -> Array:
    """Deflection (n, k) under loads (n, k) that do not change; the structure must be held."""
    if not modes.squares.all():
        raise ModelError("the structure is free: under a constant force it does not come to rest")
    Phi = modes.shapes
    return Phi @ ((Phi.T @ loads) / modes.squares[:, None]) + residual(M, modes, loads)


def residual_modes(M: Sparse, K: Sparse, left: Array) -> tuple[Array, Array]:
    """Modes that span static deflections `left` (n, k): squares (j,) and shapes (n, j) by mass.

    Orthogonal to the kept modes, as the deflections are, by mass and by stiffness. There are fewer
    than deflections where these depend on each other or have no mass.
    """
    size = np.sqrt(np.maximum(np.einsum("ij,ij->j", left, K @ left), 0.0))
    V = left[:, size > 0] / size[size > 0]
    if not V.shape[1]:
        return np.zeros(0), np.zeros((len(left), 0))
    # Flexible first: 1 / squares of M x = theta K x; those without mass, or twice, drop out.
    stiff, U = np.linalg.eigh(V.T @ (K @ V))
    kept = stiff > 1e-10 * stiff[-1]
    V = V @ (U[:, kept] / np.sqrt(stiff[kept]))
    theta, Q = np.linalg.eigh(V.T @ (M @ V))
    some = theta > max(theta[-1], 0.0) * _MASSLESS**0.5
    squares = 1 / theta[some][::-1]
    return squares, (V @ Q[:, some])[:, ::-1] * np.sqrt(squares)

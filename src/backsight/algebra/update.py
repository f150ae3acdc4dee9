"""Linear Gaussian measurement update in Joseph form, with rows that were not measured."""

import casadi as ca

from backsight.algebra.factor import solve_spd


def masked(H: ca.SX, e: ca.SX, R: ca.SX, mask: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    r"""Delete the rows that were not measured, without changing a size.

    With :math:`M = \mathrm{diag}(m)`: :math:`H \leftarrow M H`, :math:`e \leftarrow M e`,
    :math:`R \leftarrow M R M + (I - M)`. The update is then exactly the one of the remaining
    rows, also for correlated R.

    Parameters
    ----------
    H : (ny, nx)
    e : (ny,)
    R : (ny, ny)
    mask : (ny,), 1 where measured, else 0
    """
    M = ca.diag(mask)
    return M @ H, mask * e, M @ R @ M + ca.diag(1 - mask)


def gain(P: ca.SX, H: ca.SX, R: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Kalman gain K = P H' S^-1 (nx, ny) and innovation covariance S = H P H' + R (ny, ny)."""
    PHt = P @ H.T
    S = H @ PHt + R
    return solve_spd(S, PHt.T).T, S


def joseph(P: ca.SX, K: ca.SX, H: ca.SX, R: ca.SX) -> ca.SX:
    """(I - K H) P (I - K H)' + K R K': positive semidefinite for every gain, however rounded."""
    A = ca.SX.eye(P.shape[0]) - K @ H
    return A @ P @ A.T + K @ R @ K.T

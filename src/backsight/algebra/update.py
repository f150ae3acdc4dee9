"""Linear Gaussian measurement update in Joseph form, with rows that have weights or are missing."""

import casadi as ca

from backsight.algebra.factor import solve_spd


def masked(H: ca.SX, e: ca.SX, R: ca.SX, mask: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    r"""Weight the rows, and delete those that were not measured, without changing a size.

    With :math:`M = \mathrm{diag}(m)` and :math:`B = \mathrm{diag}(m > 0)`:
    :math:`H \leftarrow M H`, :math:`e \leftarrow M e`, :math:`R \leftarrow B R B + (I - B)`. The
    update is then exactly the one of the measured rows with the covariance
    :math:`M^{-1} R M^{-1}` (see `noise_of`), also for correlated R.

    Parameters
    ----------
    H : (ny, nx)
    e : (ny,)
    R : (ny, ny)
        Of the nominal noise.
    mask : (ny,)
        Nominal standard deviation of the noise by that of the sample: 0 where not measured, else 1
        unless the sample has a noise of its own.
    """
    seen = measured(mask)
    M, B = ca.diag(mask), ca.diag(seen)
    return M @ H, mask * e, B @ R @ B + ca.diag(1 - seen)


def measured(mask: ca.SX) -> ca.SX:
    """1 where measured, else 0, of the weights that `masked` takes."""
    return mask > 0


def noise_of(R: ca.SX, mask: ca.SX) -> ca.SX:
    """Covariance of the noise of a sample with these weights; nominal where not measured."""
    D = ca.diag(1 / ca.if_else(measured(mask), mask, 1))
    return D @ R @ D


def gain(P: ca.SX, H: ca.SX, R: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Kalman gain K = P H' S^-1 (nx, ny) and innovation covariance S = H P H' + R (ny, ny)."""
    PHt = P @ H.T
    S = H @ PHt + R
    return solve_spd(S, PHt.T).T, S


def joseph(P: ca.SX, K: ca.SX, H: ca.SX, R: ca.SX) -> ca.SX:
    """(I - K H) P (I - K H)' + K R K': positive semidefinite for every gain, however rounded."""
    A = ca.SX.eye(P.shape[0]) - K @ H
    return A @ P @ A.T + K @ R @ K.T

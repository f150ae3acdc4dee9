r"""A whole recording of a linear model with unknown forces as one least-squares problem.

A Kalman filter removes the states: its innovations, divided by their standard deviations, are
white, and of the forces only their own responses are left in them,
:math:`S_k^{-1/2} e_k = \sum_j h_{jk} d_j + v_k`. Background and measurement noise may be
correlated, so that the filter is written for the prediction alone,

.. math::
    x_{k+1} = A x_k + E d_k + K_k e_k, \quad K_k = (A P_k C' + M) S_k^{-1}, \quad
    P_{k+1} = A P_k A' + Q - K_k S_k K_k',

and states are found backwards from :math:`r_{k-1} = C' S_k^{-1} e_k + (A - K_k C)' r_k` as
:math:`x_k + P_k r_{k-1}`, which needs no inverse of P.

Source: De Jong, Penzer, "Diagnosing shocks in time series", 1998, Journal of the American
Statistical Association 93, doi:10.1080/01621459.1998.10473731.
"""

import dataclasses

import numpy as np

from backsight.estimators.force_estimator import Forced
from backsight.sparse._matrices import MatricesInTime
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class Whitened:
    """A Kalman filter over a recording, and what it makes of forces; all scaled.

    Parameters
    ----------
    forced : Forced
    matrices : MatricesInTime
        The model at every sample.
    y : (n, ny) array
        Outputs; 0 where not measured.
    mask : (n, ny) array
        Positive where measured: the nominal standard deviation of the noise by that of the sample.
    P : (n, nx, nx) array
        Covariance of the prediction.
    S : (n, ny, ny) array
        Covariance of the innovation, of all outputs.
    gain : (n, nx, ny) array
        K, zero where not measured.
    root : (n, ny, ny) array
        What makes an innovation white; its rows and columns are zero where not measured.
    """

    forced: Forced
    matrices: MatricesInTime
    y: Array
    mask: Array
    P: Array
    S: Array
    gain: Array
    root: Array

    def innovations(self, d: Array) -> Array:
        """White innovations (n, ny) if the forces were d (n, nf)."""
        _, e = self._moving(d)
        return np.einsum("kij,kj->ki", self.root, e[:, :, 0])

    def responses(self) -> Array:
        """White innovations of a force of one at every place and step, (n, ny, n, nf)."""
        m, (n, ny) = self.matrices, self.y.shape
        nx, nf = m.E.shape[1:]
        found = np.zeros((n, ny, n, nf))
        x = np.zeros((nx, n * nf))
        for k in range(n):
            known, own = slice(0, k * nf), slice(k * nf, (k + 1) * nf)
            seen = np.hstack([m.C[k] @ x[:, known], m.F[k]])
            found[k, :, : k + 1] = (self.root[k] @ seen).reshape(ny, k + 1, nf)
            x[:, known] = m.A[k] @ x[:, known] - self.gain[k] @ seen[:, known]
            x[:, own] = m.E[k] - self.gain[k] @ m.F[k]
        return found

    def smoothed(self, d: Array) -> tuple[Array, Array]:
        """States (n, nx) from the whole recording, forces known, and innovations (n, ny)."""
        x, e = self._moving(d)
        return self._smoothed(x, e)[:, :, 0], e[:, :, 0]

    def outputs(self, x: Array, d: Array) -> Array:
        """Outputs (n, ny) of states (n, nx) and forces (n, nf)."""
        m = self.matrices
        return np.einsum("kij,kj->ki", m.C, x) + m.seen + np.einsum("kij,kj->ki", m.F, d)

    def moved(self, d: Array) -> Array:
        """What forces d (n, nf, c) change in `smoothed`, (n, nx, c)."""
        m = self.matrices
        return self._smoothed(*self._predicted(m.E @ d, -m.F @ d, np.zeros(len(m.A[0]))))

    def smoothed_covariance(self) -> Array:
        """Covariance of `smoothed` where the forces are known, (n, nx, nx)."""
        A, C = self.matrices.A, self.matrices.C
        found, N = np.empty_like(self.P), np.zeros_like(A[0])
        for k in reversed(range(len(self.P))):
            white, step = self.root[k] @ C[k], A[k] - self.gain[k] @ C[k]
            N = white.T @ white + step.T @ N @ step
            found[k] = self.P[k] - self.P[k] @ N @ self.P[k]
        return found

    def explained(self, moves: Array, seen: Array) -> Array:
        """White innovations (n, ny, c) of what adds to the next states and to the outputs.

        Parameters
        ----------
        moves, seen : (n, nx, c), (n, ny, c) arrays
        """
        _, e = self._predicted(moves, -seen, np.zeros(moves.shape[1]))
        return -self.root @ e

    def _moving(self, d: Array) -> tuple[Array, Array]:
        """Predictions (n, nx, 1) and innovations (n, ny, 1) of the recording, forces known."""
        m = self.matrices
        moves = m.moves[:, :, None] + m.E @ d[:, :, None]
        rest = (self.y - m.seen)[:, :, None] - m.F @ d[:, :, None]
        return self._predicted(moves, rest, self.forced.system.s.x0)

    def _predicted(self, moves: Array, rest: Array, first: Array) -> tuple[Array, Array]:
        """Predictions (n, nx, c) and innovations (n, ny, c), 0 where not measured.

        Parameters
        ----------
        moves : (n, nx, c) array
            What adds to the next state.
        rest : (n, ny, c) array
            Outputs without what the state does not do.
        first : (nx,) array
            Prediction of the first state.
        """
        x = np.tile(first[:, None], (1, moves.shape[2]))
        states, innovations = [], []
        for k in range(len(moves)):
            e = rest[k] - self.matrices.C[k] @ x
            e = np.where(self.mask[k][:, None] > 0, e, 0.0)
            states.append(x)
            innovations.append(e)
            x = self.matrices.A[k] @ x + moves[k] + self.gain[k] @ e
        return np.array(states), np.array(innovations)

    def _smoothed(self, x: Array, e: Array) -> Array:
        A, C = self.matrices.A, self.matrices.C
        found, r = np.empty_like(x), np.zeros(x.shape[1:])
        for k in reversed(range(len(x))):
            white = self.root[k].T @ (self.root[k] @ e[k])
            r = C[k].T @ white + (A[k] - self.gain[k] @ C[k]).T @ r
            found[k] = x[k] + self.P[k] @ r
        return found


def whitened(forced: Forced, matrices: MatricesInTime, y: Array, mask: Array) -> Whitened:
    """Run the Kalman filter over scaled outputs (n, ny) and their mask (n, ny)."""
    s, n = forced.system.s, len(y)
    ny, nx = matrices.C[0].shape
    P_all, S_all = np.empty((n, nx, nx)), np.empty((n, ny, ny))
    gain, root = np.zeros((n, nx, ny)), np.zeros((n, ny, ny))
    P = s.P0
    for k in range(n):
        A, C = matrices.A[k], matrices.C[k]
        E, F = matrices.E[k] * forced.sigma, matrices.F[k] * forced.sigma
        factor = 1 / np.where(mask[k] > 0, mask[k], 1.0)
        R = s.R * np.outer(factor, factor) + F @ F.T
        P_all[k], S_all[k] = P, C @ P @ C.T + R
        seen = np.flatnonzero(mask[k])
        square = np.ix_(seen, seen)
        own = np.linalg.inv(np.linalg.cholesky(S_all[k][square]))
        white = (A @ P @ C[seen].T + (E @ F.T)[:, seen]) @ own.T
        root[k][square], gain[k][:, seen] = own, white @ own
        P = A @ P @ A.T + s.Q + E @ E.T - white @ white.T
        P = (P + P.T) / 2
    return Whitened(forced, matrices, y, mask, P_all, S_all, gain, root)

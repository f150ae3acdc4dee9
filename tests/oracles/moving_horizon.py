"""The observer of Polóni et al. (ACC 2012) on the stage once more, in NumPy and SciPy.

Written apart from the package on purpose: by hand in scaled variables, textbook Kalman update
without Joseph form, `scipy.optimize.least_squares` (Levenberg-Marquardt) in every window,
sensitivities by the complex step, triangular solves with Cholesky factors of P instead of a
change of variables.
"""

import dataclasses

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import least_squares

from oracles.stage import DT, SCALES, SIGMA_W, SIGMA_X0, SIGMA_Y, SU, SY, X0

S1, S2, S3, S4, S5, S6 = SCALES
Q = np.diag((SIGMA_W / SCALES) ** 2 / DT)
R = (SIGMA_Y / SY) ** 2
POSITIVE = [2, 3, 4]


def slope(x: np.ndarray, u: float) -> np.ndarray:
    """Scaled state equation, eq. 37; x is (6,) or (6, m)."""
    x1, x2, x3, x4, x5, x6 = x
    speed = S2 / S1 * x2
    acceleration = -S3 * S1 / S2 * x3 * x1 - S4 * x4 * x2 + S5 * SU / S2 * x5 * u + S6 / S2 * x6
    return np.array([speed, acceleration, *(0 * x1 for _ in range(4))])


def jacobian(x: np.ndarray, u: float) -> np.ndarray:
    """The matrix Z of eq. 15."""
    x1, x2, x3, x4, _, _ = x
    Z = np.zeros((6, 6))
    Z[0, 1] = S2 / S1
    a = S3 * S1 / S2
    Z[1] = [-a * x3, -S4 * x4, -a * x1, -S4 * x2, S5 * SU / S2 * u, S6 / S2]
    return Z


@dataclasses.dataclass(frozen=True)
class Observer:
    """Sections III and IV with held inputs, Heun's method and the covariance equation (eq. 14)."""

    N: int
    alpha: float
    substeps: int

    def sample(self, x: np.ndarray, u: float) -> np.ndarray:
        h = DT / self.substeps
        for _ in range(self.substeps):
            k1 = slope(x, u)
            x = x + h / 2 * (k1 + slope(x + h * k1, u))
        return x

    def predict(self, x: np.ndarray, P: np.ndarray, u: float) -> tuple[np.ndarray, np.ndarray]:
        Z, h = jacobian(x, u), DT / self.substeps
        for _ in range(self.substeps):
            k1 = Z @ P + P @ Z.T + Q
            ahead = P + h * k1
            P = P + h / 2 * (k1 + Z @ ahead + ahead @ Z.T + Q)
        return self.sample(x, u), P

    def correct(self, x: np.ndarray, P: np.ndarray, y: float) -> tuple[np.ndarray, np.ndarray]:
        K = P[:, 0] / (P[0, 0] + R)
        x = x + K * (y - x[0])
        x[POSITIVE] = np.maximum(x[POSITIVE], 0.0)
        P = P - np.outer(K, P[0])
        return x, (P + P.T) / 2

    def window(self, x_bar, P, us, ys) -> np.ndarray:
        """Minimiser of eq. 26 divided by R."""
        L = np.linalg.cholesky(P)

        def residuals(x: np.ndarray) -> np.ndarray:
            rows, moving = [], x
            for u, y in zip(us, ys, strict=True):
                rows.append(np.sqrt(self.alpha / R) * (moving[0] - y))
                moving = self.sample(moving, u)
            return np.vstack([solve_triangular(L, x - x_bar[:, None], lower=True), *rows])

        def value(x: np.ndarray) -> np.ndarray:
            return residuals(x[:, None])[:, 0]

        def sensitivity(x: np.ndarray) -> np.ndarray:
            return residuals(x[:, None] + 1e-30j * np.eye(6)).imag / 1e-30

        found = least_squares(
            value,
            x_bar,
            sensitivity,
            method="lm",
            x_scale="jac",
            ftol=1e-15,
            xtol=1e-15,
            gtol=1e-15,
        )
        assert np.all(found.x[POSITIVE] > 0), "the oracle does not treat active bounds"
        return found.x

    def run(self, u: np.ndarray, y: np.ndarray) -> dict[str, np.ndarray]:
        """Scaled estimates of all samples; ``x_start`` is NaN until the window is full."""
        us, ys = u / SU, y / SY
        last = start = (X0 / SCALES, np.diag((SIGMA_X0 / SCALES) ** 2))
        estimates, covariances, starts = [], [], []
        for t in range(len(us)):
            first = t - self.N
            if first < 0:
                prior = self.predict(*last, us[t - 1]) if t else last
                last, optimum = self.correct(*prior, ys[t]), np.full(6, np.nan)
            else:
                x_bar, P = self.correct(*start, ys[first])
                optimum = self.window(x_bar, P, us[first : t + 1], ys[first : t + 1])
                start, last = self.predict(optimum, P, us[first]), (optimum, P)
                for i in range(first + 1, t + 1):
                    last = self.correct(*self.predict(*last, us[i - 1]), ys[i])
            estimates.append(last[0])
            covariances.append(last[1])
            starts.append(optimum)
        return {
            "x_hat": np.array(estimates),
            "P": np.array(covariances),
            "x_start": np.array(starts),
        }

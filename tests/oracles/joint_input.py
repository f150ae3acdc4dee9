"""The two filters of Gillijns and De Moor step by step as in their papers, in NumPy.

The package has one gain for both; here are their three steps each, with the gains and covariances
that the papers give.
"""

import numpy as np


def without_feedthrough(y, *, A, G, C, Q, R, x0, P0):
    """Automatica 43 (2007) 111-116: states (n, nx), P, forces before each sample (n, m), P_d.

    The first sample, which no force precedes, is an ordinary correction; its force is NaN.
    """
    x, P, rows = x0, P0, []
    m = G.shape[1]
    for k, measured in enumerate(y):
        kept = np.isfinite(measured)
        H, z, noise = C[kept], measured[kept], R[np.ix_(kept, kept)]
        S = H @ P @ H.T + noise
        if k == 0:
            d, P_d = np.full(m, np.nan), np.full((m, m), np.nan)
            K = P @ H.T @ np.linalg.inv(S)
            x, P = x + K @ (z - H @ x), P - K @ S @ K.T
        else:
            F = H @ G
            P_d = np.linalg.inv(F.T @ np.linalg.inv(S) @ F)
            M = P_d @ F.T @ np.linalg.inv(S)
            d = M @ (z - H @ x)
            star = x + G @ d
            left = np.eye(len(x)) - G @ M @ H
            P_star = left @ P @ left.T + G @ M @ noise @ M.T @ G.T
            right = np.eye(len(z)) - F @ M
            crossed = P_star @ H.T - G @ M @ noise
            spread = right @ S @ right.T
            # What the forces took is gone from the residual: its rank is that of the rest.
            alpha = np.linalg.eigh(spread)[1][:, m:].T
            K = crossed @ alpha.T @ np.linalg.inv(alpha @ spread @ alpha.T) @ alpha
            x, P = star + K @ (z - H @ star), P_star - K @ crossed.T
        rows.append((x, P, d, P_d))
        x, P = A @ x, A @ P @ A.T + Q
    return [np.array(column) for column in zip(*rows, strict=True)]


def with_feedthrough(y, *, A, G, C, D, Q, R, x0, P0):
    """Automatica 43 (2007) 934-937: states (n, nx), P, forces of each sample (n, m), P_d."""
    x, P, rows = x0, P0, []
    for measured in y:
        S = C @ P @ C.T + R
        P_d = np.linalg.inv(D.T @ np.linalg.inv(S) @ D)
        d = P_d @ D.T @ np.linalg.inv(S) @ (measured - C @ x)
        K = P @ C.T @ np.linalg.inv(S)
        x = x + K @ (measured - C @ x - D @ d)
        P = P - K @ (S - D @ P_d @ D.T) @ K.T
        P_xd = -K @ D @ P_d
        rows.append((x, P, d, P_d))
        both, ahead = np.block([[P, P_xd], [P_xd.T, P_d]]), np.hstack([A, G])
        x, P = A @ x + G @ d, ahead @ both @ ahead.T + Q
    return [np.array(column) for column in zip(*rows, strict=True)]

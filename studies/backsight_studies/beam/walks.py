"""Filters for forces that act at all times: as random walks, or knowing nothing of them."""

import numpy as np
import xarray as xr

from backsight.estimators.joint_input import JointInput
from backsight.estimators.kalman import KalmanFilter
from backsight.estimators.uncertainty import Noise, Prior
from backsight.models.lti import lti
from backsight.run.estimation import estimate
from backsight.types import Array
from backsight_studies.beam.evaluate import output_mse
from backsight_studies.beam.plant import DT, FORCES, NODES, N, forces, model, sampled
from backsight_studies.beam.tuning import EPS_R

PLACES: dict[str, tuple[int, ...]] = {
    "all eight": tuple(range(len(NODES))),
    "at the sensors": (3, 5, 7),
    "at three of the hits, without F2": (7, 4, 1),
    "at three of the hits, without F4": (7, 6, 4),
}
"""Numbers of the places at which a force is looked for."""

VARIANCES = 10.0 ** np.arange(-4, 7)
"""Of the steps of the walks, per sample [N2]; the best one counts."""

BACKGROUND = 1e-6
"""Variance of forces without memory at all places [N2]."""


def best_walk(thickness: float, places: tuple[int, ...], recording: xr.Dataset) -> float:
    """Least mean square error of the forces over the variance of the steps [N2].

    It counts the samples that are outputs of windows, and the better one of both estimates.
    """
    d, errors = forces(), []
    for variance in VARIANCES:
        errors += [output_mse(f, d) for f in walks(thickness, places, recording, variance)]
    return min(errors)


def joint(thickness: float, places: tuple[int, ...], recording: xr.Dataset) -> Array:
    """Forces (windows, nodes) at no more places than sensors, of which nothing is known."""
    B, windows = sampled(thickness)[1], recording.sizes["time"] - N
    made = JointInput(
        Noise(sigma_y=np.sqrt(EPS_R), Q=BACKGROUND * B @ B.T),
        Prior(P0=np.zeros((len(B), len(B)))),
        tuple(FORCES[i] for i in places),
    )
    result = estimate(made, model(thickness), recording)
    found = np.zeros((windows, B.shape[1]))
    found[:, places] = result["d_hat"].values[1 : windows + 1]
    return found


def walks(
    thickness: float, places: tuple[int, ...], recording: xr.Dataset, variance: float
) -> tuple[Array, Array]:
    """Forces (windows, nodes) by the filter one sample later, and from the whole recording.

    A force at one sample is not seen before the next one.
    """
    beam, (A, B, C) = model(thickness), sampled(thickness)
    nx, n, windows = len(A), len(places), recording.sizes["time"] - N
    A = np.block([[A, B[:, places]], [np.zeros((n, nx)), np.eye(n)]])
    C = np.hstack([C, np.zeros((len(C), n))])
    Q = np.diag(np.full(nx + n, variance))
    Q[:nx, :nx] = BACKGROUND * B @ B.T
    states = [*beam.states, *(beam.parameters[i] for i in places)]
    nothing = np.zeros((nx + n, 0))
    walking = lti(A, nothing, C, states=states, inputs=(), outputs=beam.outputs, dt=DT)
    made = KalmanFilter(Noise(sigma_y=np.sqrt(EPS_R), Q=Q), Prior(P0=np.zeros_like(Q)))
    result = estimate(made, walking, recording)
    filtered, smoothed = np.zeros((2, windows, B.shape[1]))
    filtered[:, places] = result["x_hat"].values[1 : windows + 1, nx:]
    smoothed[:, places] = _smoothed(result, A, Q, C)[:windows, nx:]
    return filtered, smoothed


def _smoothed(result: xr.Dataset, A: Array, Q: Array, C: Array) -> Array:
    """States from all samples: the smoother of Bryson and Frazier, which inverts no covariance."""
    x, P, e, S = (result[name].values for name in ("x_hat", "P", "e", "S"))
    x, coming = x.copy(), np.zeros(len(A))
    for k in range(len(x) - 1, -1, -1):
        before = A @ P[k - 1] @ A.T + Q if k else np.zeros_like(Q)
        seen = np.linalg.solve(S[k], C)
        x[k] += P[k] @ coming
        coming = A.T @ (seen.T @ e[k] + coming - seen.T @ C @ before @ coming)
    return x

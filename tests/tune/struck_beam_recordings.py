"""Recordings of the struck cantilever of three millimetres, and what looks for the hits."""

import dataclasses

import numpy as np
import xarray as xr

from backsight import schema
from backsight.estimators import CompressiveSensingMHE
from backsight.estimators.arrival import SmoothedArrival
from oracles import struck_beam


def recording(
    sigma: float = 0.0, seed: int = 0, *, background: float = 0.0, hits: float = 1.0
) -> xr.Dataset:
    """With noise of the sensors [m], small forces everywhere [N], and hits of a size."""
    n, rng = struck_beam.SAMPLES, np.random.default_rng(seed)
    (A, B, C), x, y = struck_beam.matrices(0.003), np.zeros(6), []
    for d in hits * struck_beam.forces() + background * rng.standard_normal((n, 8)):
        y.append(C @ x + sigma * rng.standard_normal(3))
        x = A @ x + B @ d
    return schema.recording(
        np.arange(n) * struck_beam.DT, u=np.zeros((n, 0)), y=np.array(y),
        inputs={}, outputs=dict.fromkeys(("s1", "s2", "s3"), "m"), dt=struck_beam.DT,
    )  # fmt: skip


def estimator(thickness: float = 0.003, lam: float = 15.0) -> CompressiveSensingMHE:
    made = struck_beam.estimator(thickness, eps_Q=0.0739, eps_R=1e-10, lam=lam)
    return dataclasses.replace(made, threshold=0.0, arrival=SmoothedArrival())

"""The same likelihood maximised by statsmodels: ``python -m benchmarks.tuning_peer``.

A linear oscillator whose sensor noise, process noise and, in the second case, stiffness and damping
are free, without a prior. statsmodels runs its own L-BFGS; times are the least of three.
"""

import dataclasses
import time
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import scipy

import backsight as bs
from backsight.tune import Free, fit
from backsight.types import Array
from benchmarks.tuning_problems import MACHINES

DT, SIGMA_X0 = 0.01, 0.1
START = {"sigma_y.y": 1e-2, "sigma_w.q": 1e-3, "sigma_w.v": 1e-3, "k": 130.0, "b": 0.3}


def ours(recording: Any, *, parameters: bool) -> Array:
    """Values by Backsight."""
    noise = bs.Noise(sigma_y=1e-2, sigma_w={"q": 1e-3, "v": 1e-3})
    k, b = (START["k"], START["b"]) if parameters else (100.0, 0.5)
    names = ["sigma_y", "sigma_w", *(["k", "b"] if parameters else [])]
    kf = bs.KalmanFilter(noise, bs.Prior(sigma_x0=SIGMA_X0))
    found = fit(
        kf,
        bs.sdof(k=k, b=b),
        recording,
        free=[Free(n, spread=np.inf) for n in names],
        check=False,
        restarts=0,
    )
    return np.array(list(found.values.values()))


def theirs(recording: Any, *, parameters: bool) -> Array:
    """Values by statsmodels."""
    from statsmodels.tsa.statespace.mlemodel import MLEModel

    names = list(START) if parameters else list(START)[:3]

    class Oscillator(MLEModel):
        def __init__(self) -> None:
            super().__init__(endog=recording["y"].values, k_states=2, k_posdef=2)
            self["design"], self["selection"] = np.array([[1.0, 0.0]]), np.eye(2)
            self.ssm.initialize_known(np.zeros(2), SIGMA_X0**2 * np.eye(2))
            self.carry(100.0, 0.5)

        def carry(self, k: float, b: float) -> None:
            joint = np.zeros((3, 3))
            joint[:2] = [[0, 1, 0], [-k, -b, 1]]
            whole = scipy.linalg.expm(joint * DT)
            self["transition"] = whole[:2, :2]
            self["state_intercept"] = whole[:2, 2:] @ recording["u"].values.T

        @property
        def start_params(self) -> Array:
            return np.log([START[n] for n in names])

        def update(self, params: Array, **given: Any) -> None:
            values = np.exp(super().update(params, **given))
            self["obs_cov", 0, 0] = values[0] ** 2
            self["state_cov"] = np.diag(values[1:3] ** 2)
            if parameters:
                self.carry(values[3], values[4])

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        fitted = Oscillator().fit(disp=False, maxiter=500, pgtol=1e-9, factr=10)
    return np.exp(fitted.params)


def timed(search: Callable[..., Array], recording: Any, *, parameters: bool) -> tuple[float, Array]:
    """Least seconds of three, and the values."""
    least, found = np.inf, np.zeros(0)
    for _ in range(3):
        began = time.perf_counter()
        found = search(recording, parameters=parameters)
        least = min(least, time.perf_counter() - began)
    return least, found


def main() -> None:
    """Print seconds of both and the largest relative difference."""
    for samples, parameters in ((3000, False), (3000, True), (20_000, False)):
        machine = dataclasses.replace(MACHINES[0], sigma_w={"q": 2e-4, "v": 1e-2})
        recording, _ = machine.record(1, samples=samples)
        mine, a = timed(ours, recording, parameters=parameters)
        yours, b = timed(theirs, recording, parameters=parameters)
        print(
            f"{samples} samples, {len(a)} values: Backsight {mine:.3g} s, statsmodels {yours:.3g} "
            f"s ({yours / mine:.0f} times), values differ by {np.abs(a / b - 1).max():.1e}"
        )


if __name__ == "__main__":
    main()

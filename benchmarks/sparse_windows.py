"""Windows with sparse forces by what follows the l1 norm, of a linear and of a nonlinear model.

``python -m benchmarks.sparse_windows`` prints microseconds per window: of `benchmarks.cantilever`
with six states, and of the same with its three frequencies among the states. Every figure is the
smallest of some runs, since others may use the machine, too.
"""

import argparse
import dataclasses
import math

import casadi as ca
import numpy as np
import xarray as xr

import backsight as bs
from backsight.models.lti import state_space
from backsight.models.signals import Named
from backsight.types import Array
from benchmarks import cantilever
from benchmarks.cantilever import DAMPING, DT, FORCES, SENSORS

SIGMA = 1e-5
"""Of the sensors [m]."""

REFINEMENTS = {
    "the l1 norm": None,
    "Reweighting()": bs.forces.Reweighting(),
    "Exchanges()": bs.forces.Exchanges(),
}

SIZES = {"q": 1e-5, "v": 1e-3, "r": 0.02}
"""Prior of displacements and rates of modes, and of the shares by which frequencies are off."""


def unsure() -> bs.Model:
    """The same in discrete time, each mode exactly, with frequencies as states."""
    A, B, C, _ = state_space(bs.forces.forces_as_inputs(cantilever.model(0.0), FORCES))
    omega = np.sqrt(-np.diag(A[3:, :3]))

    def f(x: Named, _: Named, p: Named) -> list[ca.SX]:
        pushed = ca.DM(B[3:]) @ ca.vertcat(*(p[name] for name in FORCES))
        places, rates = [], []
        for i, z in enumerate(DAMPING):
            w = omega[i] * (1 + x[f"r{i}"])
            a, wd = z * w, w * math.sqrt(1 - z**2)
            e, c, s = ca.exp(-a * DT), ca.cos(wd * DT), ca.sin(wd * DT)
            q, v, still = x[f"q{i}"], x[f"v{i}"], e * (c + a / wd * s)
            places.append(still * q + e * s / wd * v + (1 - still) / w**2 * pushed[i])
            rates.append(e * s / wd * (pushed[i] - w**2 * q) + e * (c - a / wd * s) * v)
        return [*places, *rates, *(x[f"r{i}"] for i in range(3))]

    def h(x: Named, _: Named, __: Named) -> list[ca.SX]:
        return ca.vertsplit(ca.DM(C[:, :3]) @ ca.vertcat(*(x[f"q{i}"] for i in range(3))))

    return bs.Model(
        f=f,
        h=h,
        states=dict.fromkeys((f"{s}{i}" for s in SIZES for i in range(3)), ""),
        inputs={},
        outputs=dict.fromkeys(SENSORS, "m"),
        parameters=dict.fromkeys(FORCES, (0.0, "N")),
        dt=DT,
    )


def struck(samples: int) -> xr.Dataset:
    """A recording with a hit of 3 to 12 N every dozen samples."""
    rng = np.random.default_rng(0)
    d: Array = np.zeros((samples, len(FORCES)))
    at = np.arange(8, samples - 5, 12)
    sizes = rng.choice([-1.0, 1.0], len(at)) * rng.uniform(3.0, 12.0, len(at))
    d[at, rng.integers(0, len(FORCES), len(at))] = sizes
    model = bs.forces.forces_as_inputs(cantilever.model(0.0), FORCES)
    return bs.simulate(model, d, dt=DT, sigma_y=SIGMA, seed=1)


def times(samples: int, runs: int) -> dict[str, dict[str, float]]:
    """Microseconds per window, by model and refinement."""
    recording = struck(samples)
    shares = bs.Prior(sigma_x0={f"{s}{i}": v for s, v in SIZES.items() for i in range(3)})
    plain = bs.CompressiveSensingMHE(
        bs.Noise(sigma_y=SIGMA), bs.Prior(sigma_x0=1e-3), forces=FORCES, lam=17.0, N=10,
        sigma_force=0.02,
    )  # fmt: skip
    along = dataclasses.replace(plain, prior=shares, lam=20.0, sigma_force=0.005, threshold=1.0)
    found: dict[str, dict[str, float]] = {}
    for name, model, base in (
        ("linear, 6 states", cantilever.model(0.0), plain),
        ("nonlinear, 9 states", unsure(), along),
    ):
        found[name] = {}
        for how, refinement in REFINEMENTS.items():
            estimator = dataclasses.replace(base, refinement=refinement)
            found[name][how] = min(
                bs.estimate(estimator, model, recording, engine="native").attrs["us_per_sample"]
                for _ in range(runs)
            )
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--samples", type=int, default=3000)
    parser.add_argument("--runs", type=int, default=10)
    given = parser.parse_args()
    for model, row in times(given.samples, given.runs).items():
        print(f"{model:20s}" + "".join(f"  {how} {value:6.1f} µs" for how, value in row.items()))

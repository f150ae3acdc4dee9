"""Draw `docs/images/consistency.png`: innovations of filters that believe in the wrong noise."""

from pathlib import Path

import numpy as np
import xarray as xr

import backsight as bs
from backsight import plot
from backsight.analysis.consistency import autocorrelation, normalised
from backsight.report.palette import ON_LIGHT

DT, SAMPLES, LAGS = 0.01, 4000, 15
SIGMA_Y, SIGMA_V = 2e-3, 1e-2
CASES = {
    "right noise": (1.0, 1.0),
    "R 10 times too small": (0.1, 1.0),
    "Q 10 times too small": (1.0, 0.1),
    "R 10 times too large": (10.0, 1.0),
}
"""Name to R and Q as the filter believes in them, relative to the truth."""


def recorded() -> xr.Dataset:
    """An oscillator under a random force that is recorded and another one that is not."""
    rng = np.random.default_rng(3)
    force = np.repeat(np.sign(rng.standard_normal(SAMPLES // 5)), 5)
    push = SIGMA_V / DT * rng.standard_normal(SAMPLES)
    return bs.simulate(
        bs.sdof(k=40.0, b=0.8, c=1.0),
        force,
        dt=DT,
        sigma_y=SIGMA_Y,
        disturbances={"v": push},
        seed=1,
    )


def filtered(recording: xr.Dataset, R: float, Q: float) -> xr.Dataset:
    """Result of a Kalman filter that believes in so many times the true variances."""
    noise = bs.Noise(sigma_y=SIGMA_Y * np.sqrt(R), sigma_w={"v": SIGMA_V * np.sqrt(Q)})
    judge = bs.KalmanFilter(noise, bs.Prior(sigma_x0=0.1))
    return bs.compare({"KF": judge}, bs.sdof(k=40.0, b=0.8, c=1.0), recording)["KF"]


def draw(path: Path) -> Path:
    """Innovations on the left, their autocorrelation on the right, a row per filter."""
    recording = recorded()
    made = plot.figure(len(CASES), 2, width=9.0, height=1.5)
    for row, (name, (R, Q)) in enumerate(CASES.items()):
        result = filtered(recording, R, Q)
        left, right = made.axes[2 * row : 2 * row + 2]
        last = row == len(CASES) - 1
        part = slice(0, 300)
        time = result["time"].values[part]
        plot.line(left, time, normalised(result)[part, 0], name=name, series=1)
        for level in (-3.0, 3.0):
            left.axhline(level, color="#656d76", linewidth=0.8, linestyle=(0, (4, 2)))
        left.set_ylim(-12, 12)
        plot.label(left, f"{name}: innovation", "σ", x="time [s]" if last else None)
        found = autocorrelation(result, LAGS)
        bound = found["bound"].values[:, 0]
        right.fill_between(found["lag"], -bound, bound, color="#656d76", alpha=0.25, linewidth=0)
        right.bar(found["lag"], found["correlation"].values[:, 0], width=0.5, color=ON_LIGHT[1])
        right.set(xlim=(0.4, LAGS + 0.6), ylim=(-0.25, 0.45))
        plot.label(right, "correlation", x="lag [samples]" if last else None)
    return plot.save(made, path, dpi=110)


if __name__ == "__main__":
    print(draw(Path(__file__).parents[1] / "images" / "consistency.png"))

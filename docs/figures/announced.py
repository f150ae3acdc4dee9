"""Draw `docs/images/announced.png`: which share of hits is announced over their size."""

import dataclasses
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import xarray as xr
from scipy.stats import norm

import backsight as bs
from backsight.run.sparse_forces import prepared
from backsight.types import Array

DT, SIGMA, APART, SIZES = 1 / 400, 0.27, 30, (1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0)
"""Sampling period [s], forces in the background [N], samples between hits, their sizes [N]."""

PLACES = {f"F{i + 1}": 0.125 + 0.04 * i for i in range(8)}

BEAM = bs.beam(
    0.405, width=0.025, thickness=0.003, youngs_modulus=65.9e9, density=7502.0,
    damping=[0.030, 0.037, 0.119], forces=PLACES,
    sensors={f"s{i}": ("displacement", x) for i, x in enumerate((0.245, 0.325, 0.405))},
)  # fmt: skip

METHOD = bs.CompressiveSensingMHE(
    noise=bs.Noise(sigma_y=1e-5), prior=bs.Prior(sigma_x0=1e-3), forces=tuple(PLACES),
    sigma_force=SIGMA, lam=17.0,
)  # fmt: skip


def estimated(method: bs.CompressiveSensingMHE, hits: Array, seed: int) -> xr.Dataset:
    """Result of a recording with hits and the forces in the background that are stated."""
    pushed = hits + SIGMA * np.random.default_rng(seed + 1).standard_normal(hits.shape)
    plant = bs.forces.forces_as_inputs(BEAM, list(PLACES))
    recording = bs.simulate(plant, pushed, dt=DT, sigma_y=1e-5, seed=seed)
    return bs.estimate(method, BEAM, recording)


def announced(method: bs.CompressiveSensingMHE, size: float, per_hour: float) -> tuple[float, int]:
    """Share of 200 hits that is announced, at most a step and a place off, and false alarms."""
    rng, hits = np.random.default_rng(0), np.zeros((200 * APART, 8))
    at = np.arange(APART, len(hits) - APART, APART)
    place = rng.integers(0, 8, len(at))
    hits[at, place] = size * rng.choice([-1, 1], len(at))
    told = bs.forces.announce_hits(estimated(method, hits, 5), per_hour=per_hour)
    step = np.array([round(hit.time / DT - 0.5) for hit in told])
    where = np.array([list(PLACES).index(hit.place) for hit in told])
    right = [
        ((abs(step - k) <= 1) & (abs(where - w) <= 1)).any() for k, w in zip(at, place, strict=True)
    ]
    return float(np.mean(right)), len(told) - int(np.sum(right))


def bound(size: float, per_hour: float) -> float:
    """Share that could be announced if no hit were ever put to a wrong place.

    The likelihood ratio of one hit at a known place and step against none is normal, with the
    squared length of its white response as mean; its level is that of as many tries as there are
    steps and places.
    """
    quiet = bs.simulate(bs.forces.forces_as_inputs(BEAM, list(PLACES)), np.zeros((61, 8)), dt=DT)
    search = prepared(METHOD, BEAM, quiet)
    length = np.sqrt(search.regression.squares[search.step == 30])
    tries = 3600 / DT * len(PLACES)
    return float(norm.cdf(size * length - norm.isf(0.5 * per_hour / tries)).mean())


def draw(path: Path) -> Path:
    """Count, print and draw."""
    fewest = dataclasses.replace(METHOD, refinement=bs.forces.Exchanges())
    kept = [dataclasses.replace(method, bias="kept") for method in (METHOD, fewest)]
    fig, axes = plt.subplots(figsize=(6, 3.2), layout="constrained")
    labels = ("l1, bias removed", "l1, bias kept", "exchanges")
    for method, label in zip((METHOD, *kept), labels, strict=True):
        quiet = estimated(method, np.zeros((60_000, 8)), 1)
        for per_hour, style in ((1.0, "o-"), (100.0, "s--")):
            false = len(bs.forces.announce_hits(quiet, per_hour=per_hour))
            rows = [announced(method, size, per_hour) for size in SIZES]
            print(label, per_hour, f"{false} false in {60_000 * DT:.0f} s of noise", rows)
            shares = [share for share, _ in rows]
            axes.plot(SIZES, shares, style, label=f"{label}, {per_hour:g}/h")
    limits = [bound(size, 1.0) for size in SIZES]
    print("bound 1.0", limits)
    axes.plot(SIZES, limits, "k:", label="bound, 1/h")
    axes.set(xlabel="size of the hit [N]", ylabel="share announced", ylim=(0, 1.02))
    axes.legend(fontsize=8)
    fig.savefig(path, dpi=150)
    return path


if __name__ == "__main__":
    print(draw(Path(__file__).parents[1] / "images" / "announced.png"))

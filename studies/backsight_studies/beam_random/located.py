r"""Hits between the places: how well a recording can tell them, and how well they are told.

Half-sines of random place, moment, width and size. Motion is Duhamel's integral over each mode,

.. math:: q_i(t) = \int_0^t \frac{e^{-a_i (t - \tau)} \sin \omega_i (t - \tau)}{\omega_i}
    \phi_i(x) F(\tau) d\tau,

with the beam's own shapes at the place. The Cramér-Rao bound is that of place, beginning, width and
size of all hits and of the first state together; derivatives are differences of that integral, so
that nothing of the estimators is in it. ``python -m backsight_studies.beam_random.located`` prints
errors and bound, in a few minutes.
"""

import argparse
import dataclasses
import functools
import math

import numpy as np
import xarray as xr
from scipy.signal import fftconvolve

import backsight as bs
from backsight.models.lti import state_space
from backsight.models.structures.beam import beam
from backsight.types import Array
from backsight_studies.beam.plant import (
    DAMPING,
    DENSITY,
    DT,
    FORCES,
    LENGTH,
    NODES,
    SAMPLES,
    SENSORS,
    THICKNESS,
    WIDTH,
    YOUNGS_MODULUS,
    frequencies,
    model,
)
from backsight_studies.beam_random.scenarios import NOISE, SIZES

FINE = 40
"""Parts of a sample in the integral."""

STARTS, WIDTHS = (4.0, 13.0, 22.0, 31.0, 40.0), (1.5, 4.0)
"""Samples near which hits begin, and range of their widths."""

LATER = 3.0
"""Up to which a hit is later than that."""

SIGMA_Q, SIGMA_V = 1e-4, 1e-4
"""Prior of modal states."""

APART = NODES[1] - NODES[0]
"""Distance of two places [m]."""

TENTH = 0.1

LINE = bs.forces.ForceLine(NODES, supports=(0.0,))


@dataclasses.dataclass(frozen=True)
class HalfSine:
    """A hit: place [m], beginning and width [samples], size [N]."""

    place: float
    start: float
    width: float
    size: float

    @property
    def time(self) -> float:
        """Its middle [samples]."""
        return self.start + self.width / 2


@dataclasses.dataclass(frozen=True)
class Located:
    """Errors, stated deviations and least ones of all hits that were found, in places and samples.

    Parameters
    ----------
    place, time : (hits, 3) arrays
    hits, found, extra : int
        True ones, those found, and what else was found.
    """

    place: Array
    time: Array
    hits: int
    found: int
    extra: int

    def __str__(self) -> str:
        """As a table."""
        lines = [f"{self.hits} hits, {self.found} found, {self.extra} others found"]
        for name, columns in (("place", self.place), ("time", self.time)):
            error, std, least = np.abs(columns[:, 0]), columns[:, 1], columns[:, 2]
            sure, ratio = 3 * least < TENTH, error / least
            lines += [
                f"{name}: error median {np.median(error):.3f}, "
                f"95 % {np.quantile(error, 0.95):.3f}, worst {error.max():.3f}, "
                f"within a tenth {_percent(error < TENTH)}",
                f"   least deviation: median {np.median(least):.3f}, "
                f"above a twentieth {_percent(least > TENTH / 2)}; below a thirtieth "
                f"{_percent(sure)}, worst error there {error[sure].max(initial=0.0):.3f}",
                f"   error over least deviation, RMS {math.sqrt(np.mean(ratio**2)):.2f}; "
                f"3-sigma bands hold {_percent(error < 3 * std)}",
            ]
        return "\n".join(lines)


def _percent(which: np.ndarray) -> str:
    return f"{100 * which.mean():.1f} %"


@functools.cache
def _shapes(place: float) -> Array:
    """What a force at a place moves of every mode, (3,)."""
    struck = beam(
        LENGTH,
        width=WIDTH,
        thickness=THICKNESS[0.0],
        youngs_modulus=YOUNGS_MODULUS,
        density=DENSITY,
        damping=DAMPING,
        sensors={name: ("displacement", x) for name, x in SENSORS.items()},
        forces={"F": place},
    )
    return state_space(bs.forces.forces_as_inputs(struck, ["F"]))[1][3:, 0]


def outputs(hits: list[HalfSine], first: Array) -> Array:
    """Readings (samples, 3) without noise, from a first state (6,)."""
    omega, ratio = 2 * math.pi * frequencies(THICKNESS[0.0]), np.array(DAMPING)
    a, wd = ratio * omega, omega * np.sqrt(1 - ratio**2)
    C = state_space(model(THICKNESS[0.0]))[2][:, :3]
    t = DT / FINE * np.arange(SAMPLES * FINE)
    middle = (np.arange(SAMPLES * FINE) + 0.5) / FINE
    q = np.zeros((3, SAMPLES))
    for i in range(3):
        swing = np.exp(-a[i] * t)
        sine, cosine = swing * np.sin(wd[i] * t) / wd[i], swing * np.cos(wd[i] * t)
        free = first[i] * (cosine + a[i] * sine) + first[3 + i] * sine
        force = np.zeros(len(t))
        for hit in hits:
            s = (middle - hit.start) / hit.width
            course = np.where((s > 0) & (s < 1), np.sin(math.pi * np.clip(s, 0, 1)), 0.0)
            force += _shapes(hit.place)[i] * hit.size * course
        later = swing * np.exp(-a[i] * DT / FINE / 2) * np.sin(wd[i] * (t + DT / FINE / 2)) / wd[i]
        moved = np.concatenate([[0.0], fftconvolve(force, later)[: len(t) - 1]]) * DT / FINE
        q[i] = (free + moved)[::FINE]
    return (C @ q).T


def least_deviations(hits: list[HalfSine]) -> Array:
    """Least standard deviations of place [places] and time [samples] of every hit, (hits, 2)."""
    steps, columns = {"place": 1e-4, "start": 0.02, "width": 0.02, "size": 1e-2}, []
    still = np.zeros(6)
    for i, hit in enumerate(hits):
        for name, h in steps.items():
            ends = [
                dataclasses.replace(hit, **{name: min(getattr(hit, name) + s * h, _most(name))})
                for s in (-1, 1)
            ]
            low, high = (outputs([*hits[:i], end, *hits[i + 1 :]], still) for end in ends)
            apart = getattr(ends[1], name) - getattr(ends[0], name)
            columns.append(((high - low) / apart).ravel())
    base = outputs(hits, still)
    columns += [(outputs(hits, e) - base).ravel() for e in np.eye(6)]
    J = np.array(columns).T / NOISE
    known = np.concatenate(
        [np.zeros(4 * len(hits)), np.full(3, SIGMA_Q**-2), np.full(3, SIGMA_V**-2)]
    )
    information = J.T @ J + np.diag(known)
    size = np.sqrt(np.diag(information))
    P = np.linalg.inv(information / np.outer(size, size)) / np.outer(size, size)
    found = []
    for i in range(len(hits)):
        own = P[4 * i : 4 * i + 4, 4 * i : 4 * i + 4]
        middle = np.array([0.0, 1.0, 0.5, 0.0])
        found.append((math.sqrt(own[0, 0]) / APART, math.sqrt(middle @ own @ middle)))
    return np.array(found)


def _most(name: str) -> float:
    """A hit may be at the end of the beam, not beyond it."""
    return NODES[-1] if name == "place" else math.inf


def random_hits(rng: np.random.Generator) -> list[HalfSine]:
    """Four hits somewhere."""
    starts = np.sort(rng.choice(STARTS, 4, replace=False)) + rng.uniform(0, LATER, 4)
    return [
        HalfSine(
            rng.uniform(NODES[0], NODES[-1]),
            start,
            rng.uniform(*WIDTHS),
            rng.uniform(*SIZES) * rng.choice([-1.0, 1.0]),
        )
        for start in starts
    ]


def method(background: float) -> bs.CompressiveSensingMHE:
    """What is known; `background` stands for what the model gets wrong: shapes between places."""
    prior = {f"q{i}": SIGMA_Q for i in (1, 2, 3)} | {f"q{i}_dot": SIGMA_V for i in (1, 2, 3)}
    return bs.CompressiveSensingMHE(
        noise=bs.Noise(sigma_y=NOISE),
        prior=bs.Prior(sigma_x0=prior),
        forces=FORCES,
        lam=17.0,
        sigma_force=background,
        dictionary=bs.forces.HalfSines((1, 2, 3, 4)),
    )


def located(seeds: range, background: float) -> Located:
    """Random recordings, and what is found in them."""
    estimator, plant = method(background), model(THICKNESS[0.0])
    place, time, found, extra = [], [], 0, 0
    for seed in seeds:
        rng = np.random.default_rng(seed)
        hits = random_hits(rng)
        y = outputs(hits, np.zeros(6)) + NOISE * rng.standard_normal((SAMPLES, 3))
        recording = bs.from_arrays(y=y, dt=DT, inputs={}, outputs=dict.fromkeys(SENSORS, "m"))
        chosen = bs.forces.find_sparse_forces(estimator, plant, recording)
        table = bs.forces.locate_hits(estimator, plant, recording, chosen, line=LINE)
        least = least_deviations(hits)
        used = set()
        for hit, bound in zip(hits, least, strict=True):
            i = _nearest(table, hit)
            if i is None:
                continue
            used.add(i)
            one = table.isel(hit=i)
            place.append(
                (
                    (float(one["place"]) - hit.place) / APART,
                    float(one["place_std"]) / APART,
                    bound[0],
                )
            )
            time.append((float(one["time"]) / DT - hit.time, float(one["time_std"]) / DT, bound[1]))
        found += len(used)
        extra += table.sizes["hit"] - len(used)
    return Located(np.array(place), np.array(time), 4 * len(seeds), found, extra)


def _nearest(table: xr.Dataset, hit: HalfSine) -> int | None:
    """The hit of a table that is nearest in time, if it is within two samples."""
    off = np.abs(table["time"].values / DT - hit.time)
    i = int(np.argmin(off))
    return i if off[i] < 2 else None


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--recordings", type=int, default=60)
    parser.add_argument("--background", type=float, default=0.02, help="sigma_force [N]")
    given = parser.parse_args()
    print(located(range(given.recordings), given.background))

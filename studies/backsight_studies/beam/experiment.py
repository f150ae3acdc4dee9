"""Everything that the study computes."""

import dataclasses
from collections.abc import Sequence

import numpy as np
import xarray as xr

from backsight.analysis.observability import check_force_locations, force_zeros
from backsight.engine.parallel import in_threads
from backsight.estimators.uncertainty import Noise
from backsight.run.estimation import estimate
from backsight.tune.sparsity import lambda_max
from backsight.types import Array
from backsight_studies.beam import expected, plant
from backsight_studies.beam.evaluate import Score, output_mse, score
from backsight_studies.beam.plant import DT, HITS, SENSORS, THICKNESS, N, forces, model, struck
from backsight_studies.beam.ridge import best_ridge
from backsight_studies.beam.sweeps import Curve, Map, built, curve, maps, scaling
from backsight_studies.beam.tuning import (
    CARRYOVERS,
    NO_CARRYOVER,
    READING_1,
    SETTINGS,
    TABLE,
    TUNED,
    Setting,
    estimator,
)
from backsight_studies.beam.walks import PLACES, best_walk, joint
from backsight_studies.beam.windows import Windows, program
from backsight_studies.study import Progress

NOISES = (0.0, 1e-6, 1e-5)
"""Standard deviations of the sensors [m]."""

SWEPT = (0.0, -10.0)
"""Mismatches of the curves over lam, and of the filters without l1 norm."""

SHOWN_WINDOW = 7
"""The window of Fig. 9."""

Key = tuple[str, str, float]


@dataclasses.dataclass(frozen=True)
class Case:
    """What one estimator found without noise."""

    windows: Windows
    score: Score


@dataclasses.dataclass(frozen=True)
class States:
    """States over one window (samples, states): truth, estimate, standard deviation."""

    truth: Array
    x: Array
    x_std: Array


@dataclasses.dataclass(frozen=True)
class Experiment:
    """All results.

    Parameters
    ----------
    frequencies : dict
        Mismatch to the three frequencies [Hz].
    locations : xarray.Dataset
        See `backsight.analysis.observability._force_locations`.
    zeros : array
        Transmission zeros from the modal forces.
    cases : dict
        (setting, reading, mismatch) to what was found without noise.
    noisy : dict
        (reading, mismatch) to the false alarms with Table 3 and noise, by seed.
    identity, through_B : dict
        Mismatch to the weight from which nothing is found, if Q = eps_Q I and if eps_Q B B'.
    curves : dict
        (mismatch, noise) to the error over lam.
    maps : dict
        Mismatch to the map over both covariances.
    scaling : float
        Largest change of a force if all weights of the cost change together [N].
    ridge : dict
        Mismatch to the least MSE without l1 norm [N2].
    walks, joint : dict
        (places, mismatch) to the MSE with forces as random walks, and with the joint input and
        state filter, for which eight places are too many [N2].
    references : dict
        Name of a reference window to the largest deviation from it [N].
    states : States
        Over the window of Fig. 9.
    """

    frequencies: dict[float, Array]
    locations: xr.Dataset
    zeros: Array
    cases: dict[Key, Case]
    noisy: dict[tuple[str, float], dict[int, int]]
    identity: dict[float, float]
    through_B: dict[float, float]
    curves: dict[tuple[float, float], Curve]
    maps: dict[float, Map]
    scaling: float
    ridge: dict[float, float]
    walks: dict[tuple[str, float], float]
    joint: dict[tuple[str, float], float]
    references: dict[str, float]
    states: States


def carry_out(seeds: Sequence[int], progress: Progress) -> Experiment:
    """Compute everything; the noise is that of the seeds."""
    true, clean = model(THICKNESS[0.0]), struck(forces())
    progress("observability and reference windows", 0.0)
    locations = check_force_locations(true, DT)
    zeros = np.sort(force_zeros(true, DT).real)
    references = {name: _reference(*given) for name, given in expected.WINDOWS.items()}
    progress("all readings of the estimator", 0.05)
    keys = [(s, reading, m) for s in SETTINGS for reading in CARRYOVERS for m in THICKNESS]
    cases = dict(zip(keys, in_threads(lambda key: _case(key, clean), keys), strict=True))
    progress("noise", 0.35)
    noisy = _noisy(seeds)
    progress("the covariance of the process noise", 0.5)
    identity, through_B = _whole_weights(clean)
    ridge = {m: best_ridge(h, TUNED, clean) for m, h in THICKNESS.items()}
    walked, joined = _filters(clean)
    states = _states(clean)
    progress("the weight of the l1 norm", 0.55)
    curves = _curves(seeds[0])
    drawn = maps(lambda share: progress("maps over both covariances", 0.6 + 0.4 * share))
    return Experiment(
        frequencies={m: plant.frequencies(h) for m, h in THICKNESS.items()},
        locations=locations,
        zeros=zeros,
        cases=cases,
        noisy=noisy,
        identity=identity,
        through_B=through_B,
        curves=curves,
        maps=drawn,
        scaling=scaling(THICKNESS[-10.0], TUNED, 7.0),
        ridge=ridge,
        walks=walked,
        joint=joined,
        references=references,
        states=states,
    )


def _case(key: Key, recording: xr.Dataset) -> Case:
    setting, reading, mismatch = key
    thickness = THICKNESS[mismatch]
    made = estimator(thickness, SETTINGS[setting][mismatch], carryover=CARRYOVERS[reading])
    found = program(made, model(thickness), DT).run(recording)
    return Case(found, score(found.alpha, forces(), HITS))


def _reference(given: dict[str, float], support: dict[tuple[int, int], float]) -> float:
    """Deviation from a window that starts from rest at sample 7."""
    setting = Setting(given["eps_Q"], given["lam"], given["eps_R"])
    recording = struck(forces()).isel(time=slice(7, 8 + N))
    (alpha,) = built(given["thickness"], setting).run(recording).alpha
    wanted = np.zeros_like(alpha)
    for place, value in support.items():
        wanted[place] = value
    return float(np.abs(alpha - wanted).max())


def _noisy(seeds: Sequence[int]) -> dict[tuple[str, float], dict[int, int]]:
    recordings = {seed: struck(forces(), sigma=NOISES[-1], seed=seed) for seed in seeds}

    def alarms(key: tuple[str, float]) -> dict[int, int]:
        reading, mismatch = key
        thickness = THICKNESS[mismatch]
        made = estimator(thickness, TABLE[mismatch], carryover=CARRYOVERS[reading])
        ready = program(made, model(thickness), DT)
        found = {seed: ready.run(r).alpha for seed, r in recordings.items()}
        return {seed: score(alpha, forces(), HITS).false for seed, alpha in found.items()}

    keys = [(reading, m) for reading in (NO_CARRYOVER, READING_1) for m in THICKNESS]
    return dict(zip(keys, in_threads(alarms, keys), strict=True))


def _whole_weights(recording: xr.Dataset) -> tuple[dict[float, float], dict[float, float]]:
    identity, through_B = {}, {}
    for mismatch, thickness in THICKNESS.items():
        setting, made = TABLE[mismatch], estimator(thickness, TABLE[mismatch])
        through_B[mismatch] = lambda_max(made, model(thickness), recording)
        states = len(plant.sampled(thickness)[0])
        noise = Noise(made.noise.sigma_y, Q=setting.eps_Q * np.eye(states))
        made = dataclasses.replace(made, noise=noise, sigma_force=0.0)
        identity[mismatch] = lambda_max(made, model(thickness), recording)
    return identity, through_B


def _filters(
    recording: xr.Dataset,
) -> tuple[dict[tuple[str, float], float], dict[tuple[str, float], float]]:
    d, walked, joined = forces(), {}, {}
    for name, places in PLACES.items():
        for m in SWEPT:
            walked[name, m] = best_walk(THICKNESS[m], places, recording)
            if len(places) <= len(SENSORS):
                joined[name, m] = output_mse(joint(THICKNESS[m], places, recording), d)
    return walked, joined


def _curves(seed: int) -> dict[tuple[float, float], Curve]:
    found = {}
    for mismatch in SWEPT:
        ready = built(THICKNESS[mismatch], TABLE[mismatch])
        for sigma in NOISES:
            found[mismatch, sigma] = curve(ready, struck(forces(), sigma=sigma, seed=seed))
    return found


def _states(recording: xr.Dataset) -> States:
    """States over the window of Fig. 9: the sample at every distance from its end."""
    last = SHOWN_WINDOW + N
    seen = recording.isel(time=slice(0, last + 1))
    made, true = estimator(THICKNESS[0.0], TABLE[0.0]), model(THICKNESS[0.0])
    columns = []
    for lag in range(N, -1, -1):
        result = estimate(dataclasses.replace(made, lag=lag), true, seen)
        columns.append((result["x_hat"].values[last - lag], result["x_std"].values[last - lag]))
    x, x_std = map(np.array, zip(*columns, strict=True))
    return States(seen["x_true"].values[-N - 1 :, : x.shape[1]], x, x_std)

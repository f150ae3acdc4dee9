"""Every observer in every scenario."""

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np
import xarray as xr

from backsight.types import Array
from backsight_studies.punch import tuning
from backsight_studies.punch.evaluate import (
    Gain,
    Measures,
    Response,
    judge_gain,
    measure,
    parameters_of,
    respond,
    run_variant,
)
from backsight_studies.punch.plant import (
    READINGS,
    STIFF,
    Reading,
    excitation,
    simulate_punch,
    with_noise,
)
from backsight_studies.punch.scenarios import (
    ADAPTIVE,
    AHG,
    EKF,
    EKF1,
    FIXED,
    GAIN_END,
    GAIN_JUMP,
    JUMPS,
    JUMPS_END,
    NOISES,
    ONLY_D,
    SECONDS,
    SPEED_NOISES,
    STARTS,
    UKF,
    UKF1,
    Scenario,
    compared,
    count,
    explored,
)
from backsight_studies.punch.tuning import Variant, observer, scaled_start
from backsight_studies.study import Progress


@dataclasses.dataclass(frozen=True)
class Row:
    """One observer from a wrong start."""

    scenario: Scenario
    seed: int
    label: str
    measures: Measures


@dataclasses.dataclass(frozen=True)
class JumpRow:
    """One observer after one jump; the seed is the first."""

    reading: Reading
    label: str
    jumped: str
    response: Response


@dataclasses.dataclass(frozen=True)
class GainRow:
    """The observer with fixed or adaptive gain on one recording."""

    reading: Reading
    seed: int
    label: str
    gain: Gain


@dataclasses.dataclass(frozen=True)
class BiasRow:
    """The extended Kalman filter that starts at the truth: error of the damping in the end."""

    speed_noise: float
    sensor_noise: float
    bias: float


@dataclasses.dataclass(frozen=True)
class Experiment:
    """All rows, and what the figures show.

    Parameters
    ----------
    rows, jumps, gains, biases : tuple
    drawn : dict
        Figure and label to the time and the estimates of m, c, d (and lambda), thinned.
    excitation : dict
        Reading to what every force contributes to the acceleration [m/s2].
    """

    rows: tuple[Row, ...]
    jumps: tuple[JumpRow, ...]
    gains: tuple[GainRow, ...]
    biases: tuple[BiasRow, ...]
    drawn: dict[tuple[str, str], dict[str, Array]]
    excitation: dict[str, dict[str, float]]

    def of(self, scenario: Scenario, label: str) -> list[Measures]:
        """Measures of one observer in one scenario, one per seed."""
        return [r.measures for r in self.rows if (r.scenario, r.label) == (scenario, label)]

    def jump(self, reading: Reading, label: str, jumped: str) -> Response:
        """Response of one observer to one jump."""
        key = (reading, label, jumped)
        return next(r.response for r in self.jumps if (r.reading, r.label, r.jumped) == key)

    def gain(self, reading: Reading, label: str) -> list[Gain]:
        """One per seed."""
        return [r.gain for r in self.gains if (r.reading, r.label) == (reading, label)]


def carry_out(seeds: Sequence[int], progress: Progress) -> Experiment:
    """Run everything."""
    work = _Work(progress, total=count(len(seeds)))
    progress("strokes of the punch", 0.0)
    motions = {r.name: simulate_punch(r, seconds=SECONDS) for r in READINGS}
    rows = tuple(_starts(seeds, motions, work))
    jumps = tuple(_jumps(seeds[0], motions, work))
    gains = tuple(_gains(seeds, motions, work))
    biases = tuple(_biases(seeds[0], motions["stiff"], work))
    return Experiment(
        rows=rows,
        jumps=jumps,
        gains=gains,
        biases=biases,
        drawn=work.drawn,
        excitation={r.name: excitation(motions[r.name], r) for r in READINGS},
    )


class _Work:
    """Tells the progress and keeps what the figures show."""

    def __init__(self, progress: Progress, *, total: int) -> None:
        self.progress, self.total, self.done = progress, total, 0
        self.drawn: dict[tuple[str, str], dict[str, Array]] = {}

    def estimate(self, variant: Variant, recording: xr.Dataset, what: str) -> xr.Dataset:
        self.progress(f"{what}: {variant.label}", self.done / self.total)
        self.done += 1
        return run_variant(variant, recording)

    def keep(self, figure: str, label: str, result: xr.Dataset, *, every: int = 10) -> None:
        series = {"time": result["time"].values, **parameters_of(result)}
        if "lam" in result:
            series["lam"] = result["lam"].values
        self.drawn[figure, label] = {name: v[::every] for name, v in series.items()}


def _starts(seeds: Sequence[int], motions: dict[str, xr.Dataset], work: _Work) -> Iterator[Row]:
    for scenario in (*STARTS, *ONLY_D):
        motion = motions[scenario.reading.name]
        for i, seed in enumerate(seeds if not scenario.only else seeds[:1]):
            recording = with_noise(motion, seed)
            variants = compared(scenario, motion)
            for variant in variants + (explored(scenario, motion) if i == 0 else []):
                result = work.estimate(variant, recording, scenario.label)
                yield Row(scenario, seed, variant.label, measure(result, recording))
                if i == 0:
                    work.keep(scenario.label, variant.label, result)


def _jumps(seed: int, motions: dict[str, xr.Dataset], work: _Work) -> Iterator[JumpRow]:
    for reading in READINGS:
        changes = {at: {p: factor * reading.truth[p]} for p, (at, factor) in JUMPS.items()}
        clean = simulate_punch(reading, seconds=JUMPS_END, changes=changes)
        recording, start = with_noise(clean, seed), scaled_start(reading, 1.2)
        for variant in (
            observer(AHG, reading, start, motions[reading.name]),
            tuning.ekf(EKF, reading, start, tuning.TUNED),
            tuning.ukf(UKF, reading, start, tuning.TUNED),
            tuning.ekf(EKF1, reading, start, tuning.DRIFTING),
            tuning.ukf(UKF1, reading, start, tuning.DRIFTING),
        ):
            result = work.estimate(variant, recording, f"{reading.name}, jumps")
            work.keep(f"jumps, {reading.name}", variant.label, result)
            ends = [*(at for at, _ in JUMPS.values()), JUMPS_END]
            for (parameter, (at, _)), until in zip(JUMPS.items(), ends[1:], strict=True):
                response = respond(result, recording, at=at, until=until)
                yield JumpRow(reading, variant.label, parameter, response)


def _gains(seeds: Sequence[int], motions: dict[str, xr.Dataset], work: _Work) -> Iterator[GainRow]:
    for reading in READINGS:
        changes = {GAIN_JUMP: {"c": JUMPS["c"][1] * reading.stiffness}}
        clean = simulate_punch(reading, seconds=GAIN_END, changes=changes)
        ranges, start = tuning.RANGES[reading.name], scaled_start(reading, 1.2)
        motion = motions[reading.name]
        for i, seed in enumerate(seeds):
            recording = with_noise(clean, seed)
            for label, gain in ((FIXED, None), (ADAPTIVE, ranges.gain)):
                variant = observer(label, reading, start, motion, lam=ranges.upper, adaptive=gain)
                result = work.estimate(variant, recording, f"{reading.name}, gain")
                judged = judge_gain(result, recording, at=GAIN_JUMP, upper=ranges.upper)
                yield GainRow(reading, seed, label, judged)
                if i == 0:
                    work.keep(f"gain, {reading.name}", label, result)


def _biases(seed: int, motion: xr.Dataset, work: _Work) -> Iterator[BiasRow]:
    for speed_noise in SPEED_NOISES:
        for sensor_noise in NOISES:
            q = (speed_noise, tuning.PLAIN[1])
            variant = tuning.ekf(f"EKF, qx = {speed_noise:g}", STIFF, STIFF.truth, q)
            recording = with_noise(motion, seed, sigma=sensor_noise)
            result = work.estimate(variant, recording, f"bias, noise of {1e6 * sensor_noise:g} µm")
            bias = measure(result, recording).bias["d"]
            yield BiasRow(speed_noise, sensor_noise, bias)


def median(values: Sequence[float]) -> float:
    """Median in which NaN ("never") counts as the largest value; NaN if it is in the middle."""
    ordered = np.sort(np.where(np.isnan(values), np.inf, values))
    middle = float(np.median(ordered)) if len(ordered) else np.nan
    return middle if np.isfinite(middle) else np.nan

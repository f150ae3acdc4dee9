"""What is checked; the statements that decide between the arrival costs."""

from collections.abc import Iterator

from backsight_studies.arrival.experiment import SHOWN, Experiment
from backsight_studies.arrival.machines import MACHINES, WINDOW, Convergence
from backsight_studies.arrival.methods import (
    ARRIVALS,
    CLIPPED,
    CONSTANT,
    FREE,
    KALMAN,
    NAIVE,
    NONE,
    SMOOTHED,
    SOUND,
    UNSCENTED,
)
from backsight_studies.arrival.plants import HORIZONS, REACTOR, SPRING
from backsight_studies.checks import Check

SAME = 1e-9
"""Distance from the Kalman filter that counts as none [standard deviations]."""

MOST = 0.9
"""Share of the recordings in which the right optimum has to be found: 45 of 50."""

NOMINAL, LEAST = 0.954, 0.92
"""Coverage of two deviations, and what a sound band has at least."""

BESIDE = 1.25
"""The default's error per that of the best arrival cost, at most."""


def checks(experiment: Experiment) -> list[Check]:
    """All checks."""
    return [
        *_linear(experiment),
        *_optimum(experiment),
        *_bands(experiment),
        *_errors(experiment),
        *(c for found in experiment.machines for c in _machine(found)),
    ]


def nonlinear(e: Experiment) -> list[str]:
    """Names of the plants with a nonlinearity."""
    return [p.name for p in e.plants if p.name != SPRING]


def _linear(e: Experiment) -> Iterator[Check]:
    where = f"runs.csv: {SPRING}, distance"
    for label in SOUND:
        worst = max(e.distance(label, N) for N in HORIZONS)
        name = f"{SPRING}, {label}: distance from the Kalman filter [standard deviations]"
        yield Check(name, 0.0, worst, SAME, worst <= SAME, where)
    shortest = HORIZONS[0]
    for label in (NONE, CONSTANT, NAIVE):
        far = e.distance(label, shortest)
        name = f"{SPRING}, {label}, N = {shortest}: is not the Kalman filter"
        yield Check(
            name, "further than 0.1 standard deviations", far, "as stated", far > 0.1, where
        )


def _optimum(e: Experiment) -> Iterator[Check]:
    where, total = f"runs.csv: {REACTOR}, right", len(e.seeds)
    for label, N in (*((SMOOTHED, N) for N in HORIZONS), (UNSCENTED, 0)):
        right = e.found(label, N)
        name = f"{REACTOR}, {label}, N = {N}: right optimum in recordings"
        yield Check(name, MOST * total, right, "at least", right >= MOST * total, where)
    for label, N in ((KALMAN, 0), (CLIPPED, 0), (FREE, SHOWN), (NONE, SHOWN)):
        right = e.found(label, N)
        name = f"{REACTOR}, {label}: misses the right optimum in most recordings"
        yield Check(name, total / 2, right, "fewer than", right < total / 2, where)


def _bands(e: Experiment) -> Iterator[Check]:
    for plant in nonlinear(e):
        where = f"summary.csv: {plant}, covered"
        share = min(e.covered(plant, SMOOTHED, N) for N in HORIZONS)
        name = f"{plant}, {SMOOTHED}: two deviations hold the truth"
        yield Check(name, NOMINAL, share, f"at least {LEAST:g}", share >= LEAST, where)
        pairs = [(e.covered(plant, NAIVE, N), e.covered(plant, SMOOTHED, N)) for N in HORIZONS]
        ratio = max(naive / sound for naive, sound in pairs)
        name = f"{plant}, {NAIVE}: coverage per that of {SMOOTHED}"
        yield Check(name, 1.0, ratio, "less than", ratio < 1.0, where)


def _errors(e: Experiment) -> Iterator[Check]:
    for plant in nonlinear(e):
        where = f"summary.csv: {plant}, error"
        found = [beside(e, plant, N) for N in HORIZONS]
        name = f"{plant}, {SMOOTHED}: error per that of the best arrival cost"
        yield Check(name, BESIDE, max(found), "at most", max(found) <= BESIDE, where)
        short, long = (e.error(plant, NONE, N) for N in (HORIZONS[0], HORIZONS[-1]))
        name = f"{plant}, {NONE}: error with N = {HORIZONS[-1]} per that with N = {HORIZONS[0]}"
        ratio = 0.0 if short == float("inf") and long < short else long / short
        yield Check(name, 1.0, ratio, "less than", ratio < 1.0, where)


def beside(e: Experiment, plant: str, N: int) -> float:
    """Error of the default arrival cost per that of the best."""
    return e.error(plant, SMOOTHED, N) / min(e.error(plant, label, N) for label in ARRIVALS)


def _machine(found: Convergence) -> Iterator[Check]:
    if found.label != WINDOW:
        return
    within = next(m.within for m in MACHINES if m.name == found.machine)
    of = f"{found.machine}, start {found.start:g}"
    for name, error in found.error.items():
        limit = within[name]
        where = f"machines.csv: {of}, {found.label}"
        text = f"{of}: relative error of {name}"
        yield Check(text, limit, abs(error), "at most", abs(error) <= limit, where)
        away = abs(found.deviations[name])
        text = f"{of}: distance of {name} from its reference [standard deviations]"
        yield Check(text, 3.0, away, "at most", away <= 3.0, where)

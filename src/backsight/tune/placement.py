"""Where sensors find sparse forces best."""

import dataclasses
import itertools
import math
from collections.abc import Callable, Sequence

import numpy as np
import xarray as xr

from backsight.description import Count, Positive, Whole, checked
from backsight.engine.parallel import in_processes
from backsight.errors import TuningError
from backsight.estimators.force_estimator import AbstractForceEstimator
from backsight.models.model import Model
from backsight.models.views.some_outputs import some_outputs
from backsight.sparse import AbstractSelection
from backsight.tune._recovery import Hits, rate_sensors

MOST = 100
"""Sets of sensors that are tried one by one; of more, sensors are added one after the other."""


@checked()
def place_sensors(
    estimator: AbstractForceEstimator,
    model: Model,
    hits: Hits,
    *,
    dt: Positive,
    count: Count,
    selection: AbstractSelection | None = None,
    runs: Count = 20,
    seed: Whole = 0,
    most: Whole = MOST,
    workers: Count = 1,
    progress: Callable[[int], None] = lambda _: None,
) -> xr.Dataset:
    """Choose sensors by how surely they find random hits, see `rate_sensors`.

    All sets are tried if they are not too many. Otherwise sensors are added one after the other,
    each time the one with which most is found; the first ones find little alone, so that the sets
    that are tried in this way need not contain the best.

    Parameters
    ----------
    estimator : AbstractForceEstimator
        Its noise is that of all candidates.
    model : Model
        Every output is a candidate for a sensor.
    hits, dt, selection, runs, seed
        As in `rate_sensors`. All sets see the same hits.
    count : int
        Sensors to choose.
    most : int
        Number of sets up to which all are tried.
    workers : int
        Processes that try sets at the same time; a script that takes more than one needs
        ``if __name__ == "__main__":``.
    progress : callable
        Told the number of sets done.

    Returns
    -------
    xarray.Dataset
        Over ``set``, the best first: ``sensors (set, slot)``, ``f1``, ``probability``, ``low``,
        ``high``. A set whose sensors do not see all forces has zeros. Attribute ``search``:
        "exhaustive" or "greedy".

    Raises
    ------
    TuningError
        If there are not so many candidates, or no set sees all forces.

    Examples
    --------
    >>> sensors, forces = {"tip": ("displacement", [1.0])}, {"hit": [1.0]}
    >>> rod = bs.modal([9.0], damping=[0.03], sensors=sensors, forces=forces)
    >>> noise, prior = bs.Noise(sigma_y=1e-5, sigma_w=1e-7), bs.Prior(sigma_x0=1e-5)
    >>> finder = bs.CompressiveSensingMHE(noise, prior, forces=("hit",), lam=15.0, N=8)
    >>> hits = bs.tune.Hits(samples=30, number=1, spacing=10)
    >>> sorted(bs.tune.place_sensors(finder, rod, hits, dt=0.01, count=1, runs=2).coords)
    []
    """
    names = [s.name for s in model.outputs]
    if not 1 <= count <= len(names):
        raise TuningError(f"count is {count}; there are {len(names)} candidates")
    trial = _Trial(estimator, model, hits, dt, selection, runs, seed)
    exhaustive = math.comb(len(names), count) <= most
    if exhaustive:
        sets = list(itertools.combinations(names, count))
        scores = in_processes(trial.score, sets, workers=workers, progress=progress)
    else:
        sets, scores = _grown(trial, names, count, workers, progress)
    if not any(score[0] > 0 for score in scores):
        raise TuningError(
            f"no set of {count} sensors finds a force; add sensors, or take better ones"
        )
    order = sorted(range(len(sets)), key=lambda i: scores[i], reverse=True)
    columns = zip(*(scores[i] for i in order), strict=True)
    found = xr.Dataset(
        {
            n: ("set", np.array(c))
            for n, c in zip(("f1", "probability", "low", "high"), columns, strict=True)
        },
        attrs={"search": "exhaustive" if exhaustive else "greedy", "runs": runs},
    )
    found["sensors"] = (("set", "slot"), np.array([sets[i] for i in order]))
    return found


Score = tuple[float, float, float, float]
"""Mean F1, probability of complete recovery, and its interval."""


@dataclasses.dataclass(frozen=True)
class _Trial:
    estimator: AbstractForceEstimator
    model: Model
    hits: Hits
    dt: float
    selection: AbstractSelection | None
    runs: int
    seed: int

    def score(self, names: Sequence[str]) -> Score:
        noise = self.estimator.noise
        chosen = [[s.name for s in self.model.outputs].index(n) for n in names]
        R = noise.measurement(self.model)[np.ix_(chosen, chosen)]
        estimator = dataclasses.replace(
            self.estimator, noise=dataclasses.replace(noise, sigma_y=None, R=R)
        )
        model = some_outputs(self.model, names)
        # The rounding of readings is in R already.
        outputs = tuple(dataclasses.replace(s, resolution=None) for s in model.outputs)
        try:
            about = rate_sensors(
                estimator,
                dataclasses.replace(model, outputs=outputs),
                self.hits,
                dt=self.dt,
                selection=self.selection,
                runs=self.runs,
                seed=self.seed,
            ).attrs
        except TuningError:
            return 0.0, 0.0, 0.0, 0.0
        return about["f1"], about["probability"], about["low"], about["high"]


def _grown(
    trial: _Trial,
    names: Sequence[str],
    count: int,
    workers: int,
    progress: Callable[[int], None],
) -> tuple[list[tuple[str, ...]], list[Score]]:
    """Sets of the last round, and their scores."""
    kept: tuple[str, ...] = ()
    sets: list[tuple[str, ...]] = []
    scores: list[Score] = []
    done = 0
    for _ in range(count):
        sets = [(*kept, n) for n in names if n not in kept]
        before = done
        scores = in_processes(
            trial.score, sets, workers=workers, progress=lambda k, n=before: progress(n + k)
        )
        done += len(sets)
        kept = sets[max(range(len(sets)), key=lambda i: scores[i])]
    return sets, scores

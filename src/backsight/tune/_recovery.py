"""How surely a set of sensors finds sparse forces: by Monte Carlo."""

import dataclasses
from collections.abc import Iterator

import numpy as np
import scipy
import xarray as xr

from backsight import schema
from backsight.analysis.forces import ForceErrors, compare_forces
from backsight.description import Count, Description, NonNegative, Positive, Sound, Whole, checked
from backsight.estimators.force_estimator import AbstractForceEstimator, Forced
from backsight.models.model import Model
from backsight.run.estimation import estimate_many
from backsight.run.sparse_forces import prepared
from backsight.sparse import AbstractSelection
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class Hits(Description):
    """Random hits at random places.

    Parameters
    ----------
    samples : int
        Length of a recording.
    number : int
        Hits in it, each one step long.
    sizes : (float, float)
        Their magnitude is uniform in between; the direction is random.
    spacing : int
        Smallest distance of two hits [samples].
    margin : int
        Samples at both ends without hits.
    least : float, optional
        Found forces smaller than this are not counted; a third of the smallest size if not given.
    steps, places : int
        How far off a hit may be found, see `compare_forces`.

    Examples
    --------
    >>> bs.tune.Hits(samples=100, number=2).number
    2
    """

    samples: Count
    number: Whole = 4
    sizes: tuple[float, float] = (3.0, 12.0)
    spacing: Count = 4
    margin: Whole = 5
    least: NonNegative | None = None
    steps: Whole = 0
    places: Whole = 0

    def conflicts(self, sound: Sound) -> Iterator[str]:
        """See `Description.conflicts`."""
        if sound("number") and not self.number:
            yield "number = 0: give a hit or more"
        if sound("sizes") and not 0 < self.sizes[0] <= self.sizes[1]:
            yield f"sizes is {self.sizes}; give the smallest and the largest magnitude"
        if sound("samples", "number", "spacing", "margin") and self.room < 1:
            yield (
                f"{self.number} hits {self.spacing} samples apart do not fit into {self.samples} "
                f"samples with a margin of {self.margin}"
            )

    @property
    def room(self) -> int:
        """Steps among which the hits are chosen, once the spacing is taken off."""
        free = self.samples - 2 * self.margin
        return free - (self.number - 1) * (self.spacing - 1) - self.number + 1

    def draw(self, rng: np.random.Generator, places: int) -> Array:
        """Forces (samples, places) of one recording."""
        d = np.zeros((self.samples, places))
        spread = np.sort(rng.integers(0, self.room, self.number))
        steps = self.margin + spread + self.spacing * np.arange(self.number)
        sizes = rng.uniform(*self.sizes, self.number) * rng.choice([-1.0, 1.0], self.number)
        d[steps, rng.integers(0, places, self.number)] = sizes
        return d

    def judged(self, found: Array, true: Array) -> ForceErrors:
        """Errors of what was found."""
        least = self.sizes[0] / 3 if self.least is None else self.least
        return compare_forces(found, true, least=least, steps=self.steps, places=self.places)


@checked()
def rate_sensors(
    estimator: AbstractForceEstimator,
    model: Model,
    hits: Hits,
    *,
    dt: Positive,
    truth: Model | None = None,
    selection: AbstractSelection | None = None,
    runs: Count = 50,
    seed: Whole = 0,
) -> xr.Dataset:
    r"""Try how surely sparse forces are found by the sensors of a model.

    The rank of the observability matrix says how many forces random walks can follow
    (`check_force_locations`); of sparse forces at more places there is no such number, for it
    depends on noise, on places that act alike, and on how close hits follow one another. So
    hits are drawn, measured with noise of the estimator's `noise`, and looked for.

    Parameters
    ----------
    estimator : AbstractForceEstimator
    model : Model
    hits : Hits
    dt : float
        Sampling period [s].
    truth : Model, optional
        What is simulated; the model itself if not given. With another one, the error of the model
        counts, too.
    selection : L1, Reweighted or Greedy, optional
        Search in the whole recording, as `find_sparse_forces` does; if not given, the moving
        window.
    runs : int
        Recordings.
    seed : int
        Of hits and noise; the same seed draws the same hits for every set of sensors.

    Returns
    -------
    xarray.Dataset
        Over ``run``: ``f1``, ``missed``, ``false_alarms``, ``magnitude``, ``exact``. Attributes:
        ``probability`` that everything is found and nothing else, its ``low`` and ``high`` (95 %
        interval of Wilson), and ``f1``, the mean.

    Raises
    ------
    TuningError, ModelError
        As `estimate`.

    References
    ----------
    Wilson, "Probable inference, the law of succession, and statistical inference", 1927,
    doi:10.1080/01621459.1927.10502953.

    Examples
    --------
    >>> sensors, forces = {"tip": ("displacement", [1.0])}, {"hit": [1.0]}
    >>> rod = bs.modal([9.0], damping=[0.03], sensors=sensors, forces=forces)
    >>> noise, prior = bs.Noise(sigma_y=1e-5, sigma_w=1e-7), bs.Prior(sigma_x0=1e-5)
    >>> finder = bs.CompressiveSensingMHE(noise, prior, forces=("hit",), lam=15.0, N=8)
    >>> hits = bs.tune.Hits(samples=30, number=1, spacing=10)
    >>> found = bs.tune.rate_sensors(finder, rod, hits, dt=0.01, runs=2)
    >>> sorted(found.data_vars)
    ['exact', 'f1', 'false_alarms', 'magnitude', 'missed']
    """
    system = estimator.forced(model if truth is None else truth, dt)
    rng = np.random.default_rng(seed)
    true = [hits.draw(rng, len(estimator.forces)) for _ in range(runs)]
    measured = [_measured(system, d, rng) for d in true]
    recordings = [_recording(model, y, dt) for y in measured]
    if selection is None:
        results = estimate_many(estimator, model, recordings)
        found = [result["d_hat"].values for result in results]
    else:
        search = prepared(estimator, model, recordings[0])
        searches = [search.measuring(y) for y in measured]
        fits = [selection.select(s) for s in searches]
        found = [s.forces(f.which, f.values) for s, f in zip(searches, fits, strict=True)]
    return _summary([hits.judged(d, t) for d, t in zip(found, true, strict=True)])


def _measured(forced: Forced, d: Array, rng: np.random.Generator) -> Array:
    """Outputs (n, ny) with noise, from the mean of the prior on and without known inputs."""
    system = forced.system
    x, rows = system.s.x0, []
    for force in d:
        rows.append(system.C @ x + forced.F @ force)
        x = system.A @ x + forced.E @ force
    root = np.linalg.cholesky(system.s.R)
    noise = rng.standard_normal((len(d), len(root))) @ root.T
    return (np.array(rows) + noise) * system.s.sy


def _recording(model: Model, y: Array, dt: float) -> xr.Dataset:
    return schema.recording(
        dt * np.arange(len(y)),
        u=np.zeros((len(y), model.nu)),
        y=y,
        inputs={s.name: s.unit for s in model.inputs},
        outputs={s.name: s.unit for s in model.outputs},
        dt=dt,
    )


def _summary(errors: list[ForceErrors]) -> xr.Dataset:
    names = ("f1", "missed", "false_alarms", "magnitude", "exact")
    result = xr.Dataset({n: ("run", np.array([getattr(e, n) for e in errors])) for n in names})
    successes = int(result["exact"].sum())
    interval = scipy.stats.binomtest(successes, len(errors)).proportion_ci(0.95, method="wilson")
    result.attrs = {
        "probability": successes / len(errors),
        "low": float(interval.low),
        "high": float(interval.high),
        "f1": float(result["f1"].mean()),
    }
    return result

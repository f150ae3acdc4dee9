"""Calibrate a model on a recording of unknown sparse forces: blindly, from the recording itself."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import numpy as np
import scipy
import xarray as xr

from backsight.description import Printed, checked
from backsight.errors import BacksightError, TuningError
from backsight.estimators.force_estimator import AbstractForceEstimator
from backsight.models.model import Model
from backsight.rounding import significant
from backsight.run.sparse_forces import prepared
from backsight.sparse import L1, ForceSearch, Greedy, refit
from backsight.types import Array

ModelOf = Callable[[dict[str, float]], Model]
"""From values by name to a model."""

Atom = tuple[int, int]
"""Step and number of an atom."""

ROUNDS = 6
"""Times that forces are chosen anew and values fitted, at most."""

STEP = 1e-4
"""Relative change of a value by which the residuals are differentiated."""

REACH = 1.3
"""Factor by which a fit may move a value at most."""

UNDETERMINED = 1e-6
"""Values are not determined if the derivatives are dependent to this share."""


@dataclasses.dataclass(frozen=True)
class Calibration(Printed):
    """What a calibration found, and how sure it is.

    Parameters
    ----------
    values, std : dict
        Value of every parameter and its standard deviation, judged by the residuals that remain.
        Errors of the model that are still in them make the true error larger.
    correlation : (p, p) array
        Of the errors of the values.
    model : Model
        With these values.
    cost, before : float
        Squared residuals and price of the forces, in squared standard deviations, with these values
        and with those at the start. A value that makes a difference lowers it by far more than 1.
    forces : int
        Number of atoms that explain the recording.
    scan : xarray.Dataset
        ``cost (scale)`` with all values at the start times a common scale.
    rival : float or None
        Scale of the next best minimum of the scan, if there is one.
    margin : float
        By how much the cost there is larger than at the best scale; infinite without a rival.
    """

    values: dict[str, float]
    std: dict[str, float]
    correlation: Array
    model: Model
    cost: float
    before: float
    forces: int
    scan: xr.Dataset
    rival: float | None
    margin: float

    def __str__(self) -> str:
        rows = [
            f"{name} = {significant(value, 6)} ± {significant(self.std[name], 2)}"
            for name, value in self.values.items()
        ]
        cost = f"cost {significant(self.before, 4)} -> {significant(self.cost, 4)}"
        rows.append(f"{cost}, {self.forces} atoms of force")
        if self.rival is not None:
            rows.append(
                f"next best scale {self.rival:.3f}: cost {significant(self.margin, 3)} more"
            )
        return "\n".join(rows)


@checked()
def calibrate(
    estimator: AbstractForceEstimator,
    model_of: ModelOf,
    recording: xr.Dataset,
    start: Mapping[str, float],
    *,
    selection: L1 | Greedy | None = None,
    span: float = 0.2,
    points: int = 25,
) -> Calibration:
    r"""Find values of a model with which few forces explain a recording.

    A structure with wrong natural frequencies rings at others than the model; only many small
    forces, all the time, would make the model follow. So the right values are those with which the
    recording costs least,

    .. math:: J(p) = \min_\alpha \sum_k e_k' S_k^{-1} e_k + \mathrm{price}(\alpha),

    with the innovations of a Kalman filter that knows the forces. Neither forces nor values need to
    be known, but the noise should be.

    First all values are changed by a common scale, over a range. From the best scale on, forces are
    chosen and values fitted (Gauss-Newton, the sizes of the forces eliminated) in turn.

    Parameters
    ----------
    estimator : AbstractForceEstimator
        As for `find_sparse_forces`. A small `sigma_force`, well below the forces looked for, makes
        the recording tell most.
    model_of : callable
        ``{name: value}`` to a model, such as ``lambda v: bs.modal([v["f1"], v["f2"]], ...)``.
    recording : xarray.Dataset
    start : dict
        Names and values to start from; all positive.
    selection : L1 or Greedy, optional
        How forces are chosen, and their price; `Greedy()` if not given.
    span : float
        Range of the common scale, 0.2 for 0.8 to 1.2.
    points : int
        Scales that are tried. Neighbours should not differ by more than the inverse of the number
        of periods that the fastest mode rings.

    Returns
    -------
    Calibration

    Raises
    ------
    TuningError
        If a setting is not possible, the recording does not tell the values, or no force is found.
    ModelError, DataError
        As `find_sparse_forces`, at the start.

    References
    ----------
    Golub, Pereyra, "The differentiation of pseudo-inverses and nonlinear least squares problems
    whose variables separate", 1973, SIAM Journal on Numerical Analysis 10, doi:10.1137/0710036.

    Examples
    --------
    >>> import numpy as np
    >>> sensors, places = {"tip": ("displacement", [1.0])}, {"hit": [1.0]}
    >>> rod = lambda v: bs.modal([v["f"]], damping=[0.03], sensors=sensors, forces=places)
    >>> forces = np.zeros((60, 1))
    >>> forces[20] = 50.0
    >>> struck = bs.simulate(
    ...     bs.forces.forces_as_inputs(rod({"f": 9.0}), ["hit"]),
    ...     forces,
    ...     dt=0.01,
    ...     sigma_y=1e-5,
    ...     seed=0,
    ... )
    >>> recording = bs.data.from_arrays(y=struck.y, inputs={}, outputs={"tip": "m"}, dt=0.01)
    >>> noise, prior = bs.Noise(sigma_y=1e-5, sigma_w=1e-7), bs.Prior(sigma_x0=1e-5)
    >>> finder = bs.CompressiveSensingMHE(noise, prior, forces=("hit",), lam=15.0, N=8)
    >>> found = bs.tune.calibrate(finder, rod, recording, {"f": 8.5}, points=3)
    >>> print(f"{found.values['f']:.1f} Hz")
    9.0 Hz
    """
    if not start or not all(np.isfinite(v) and v > 0 for v in start.values()):
        raise TuningError(f"start is {dict(start)}; give positive values by name")
    if not (0 < span < 1 and points >= 3):
        raise TuningError(f"span = {span}, points = {points}: span from 0 to 1, points from 3 on")
    task = _Task(model_of, recording, estimator, dict(start), _unbiased(selection or Greedy()))
    before, _ = task.cost(np.ones(len(start)))
    scales = 1 + np.linspace(-span, span, points)
    costs = np.array([task.tried(np.full(len(start), s)) for s in scales])
    ratios, cost, atoms = _settled(task, np.full(len(start), scales[costs.argmin()]))
    std, correlation = _certainty(task, ratios, atoms)
    rival, margin = _rival(scales, costs)
    values = task.values(ratios)
    return Calibration(
        values=values,
        std=dict(zip(values, np.array(list(start.values())) * std, strict=True)),
        correlation=correlation,
        model=model_of(values),
        cost=cost,
        before=before,
        forces=len(atoms),
        scan=xr.Dataset({"cost": ("scale", costs)}, coords={"scale": scales}),
        rival=rival,
        margin=margin,
    )


@dataclasses.dataclass(frozen=True)
class _Task:
    """The cost as a function of the values as shares of those at the start."""

    model_of: ModelOf
    recording: xr.Dataset
    estimator: AbstractForceEstimator
    start: dict[str, float]
    selection: L1 | Greedy

    def values(self, ratios: Array) -> dict[str, float]:
        return {n: v * float(r) for (n, v), r in zip(self.start.items(), ratios, strict=True)}

    def search(self, ratios: Array) -> ForceSearch:
        return prepared(self.estimator, self.model_of(self.values(ratios)), self.recording)

    def cost(self, ratios: Array) -> tuple[float, list[Atom]]:
        """Cost, and the atoms chosen."""
        search = self.search(ratios)
        fit = self.selection.select(search)
        atoms = sorted((int(search.step[i]), int(search.atom[i])) for i in fit.which)
        return fit.cost + self.selection.price(search, fit), atoms

    def tried(self, ratios: Array) -> float:
        """Cost, infinite where there is no model."""
        try:
            return self.cost(ratios)[0]
        except BacksightError:
            return np.inf

    def residual(self, ratios: Array, atoms: Sequence[Atom]) -> Array:
        """White innovations that the chosen atoms leave."""
        search = self.search(ratios)
        found = zip(search.step, search.atom, strict=True)
        number = {(int(k), int(a)): i for i, (k, a) in enumerate(found)}
        which = np.array([number[pair] for pair in atoms if pair in number], np.intp)
        fit, problem = refit(search.regression, which), search.regression
        return problem.target - problem.columns[:, fit.which] @ fit.values

    def fitted(self, ratios: Array, atoms: Sequence[Atom]) -> Array:
        """Values with which the chosen atoms fit best."""
        return scipy.optimize.least_squares(
            lambda r: self.residual(r, atoms),
            ratios,
            bounds=(ratios / REACH, ratios * REACH),
            diff_step=STEP,
            xtol=1e-8,
            max_nfev=30,
        ).x


def _settled(task: _Task, ratios: Array) -> tuple[Array, float, list[Atom]]:
    """Choose atoms and fit values in turn until the same atoms are chosen again."""
    cost, atoms = task.cost(ratios)
    for _ in range(ROUNDS):
        if not atoms:
            raise TuningError(
                "no force was found in the recording, so that it tells nothing about the values; "
                "check the noise, or lower lam or the penalty"
            )
        ratios, before = task.fitted(ratios, atoms), atoms
        cost, atoms = task.cost(ratios)
        if atoms == before:
            break
    return ratios, cost, atoms


def _certainty(task: _Task, ratios: Array, atoms: list[Atom]) -> tuple[Array, Array]:
    """Standard deviations of the ratios and their correlation."""
    residual = task.residual(ratios, atoms)
    steps = np.diag(STEP * ratios)
    changes = [(task.residual(ratios + h, atoms) - residual) / h.sum() for h in steps]
    J = np.array(changes).T
    size = np.linalg.norm(J, axis=0)
    names = list(task.start)
    values, vectors = np.linalg.eigh((J / size).T @ (J / size))
    if values[0] < UNDETERMINED:
        alike = ", ".join(n for n, v in zip(names, vectors[:, 0], strict=True) if abs(v) > 0.1)
        raise TuningError(
            f"the recording does not determine {alike}; calibrate fewer values, or record longer"
        )
    freedom = max(int(np.isfinite(task.recording["y"]).sum()) - len(names) - len(atoms), 1)
    P = np.linalg.inv(J.T @ J) * float(residual @ residual) / freedom
    std = np.sqrt(np.diag(P))
    return std, P / np.outer(std, std)


def _rival(scales: Array, costs: Array) -> tuple[float | None, float]:
    """Scale of the second lowest local minimum, and what it costs more."""
    edged = np.concatenate([[np.inf], costs, [np.inf]])
    low = np.flatnonzero((costs < edged[:-2]) & (costs <= edged[2:]))
    if len(low) < 2:
        return None, np.inf
    first, second = low[np.argsort(costs[low])[:2]]
    return float(scales[second]), float(costs[second] - costs[first])


def _unbiased(selection: L1 | Greedy) -> L1 | Greedy:
    """Without the second fit of the l1 norm, which would lower what its price belongs to."""
    return dataclasses.replace(selection, refit=False) if isinstance(selection, L1) else selection

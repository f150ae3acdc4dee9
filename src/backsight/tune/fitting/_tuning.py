"""The steps of a fit: search, choose an option, judge what was found."""

import dataclasses
from collections.abc import Sequence

import numpy as np
import xarray as xr

from backsight.errors import TuningError
from backsight.estimators.base import AbstractEstimator
from backsight.models.model import Model
from backsight.tune.fitting._descent import (
    NEAR,
    ROUGHLY,
    Optimum,
    Search,
    descend,
    search_all,
    spread_of,
)
from backsight.tune.fitting._doubts import (
    doubts_of,
    doubts_of_halves,
    doubts_of_search,
    profiles_of,
)
from backsight.tune.fitting._halving import Candidate, Halving, candidates_of, halve
from backsight.tune.fitting._objective import Objective, Runner, coordinates_of
from backsight.tune.fitting._output_error import (
    doubts_of_simulation,
    simulating,
    unknowns_of_simulation,
)
from backsight.tune.fitting.criteria import AbstractCriterion, Likelihood, Simulation
from backsight.tune.fitting.runners import (
    Data,
    Rebuilt,
    able_settings,
    delays_of,
    quick_runner,
)
from backsight.tune.fitting.tuned import HeldOut, Tuned, correlation_of
from backsight.tune.fitting.values import AbstractScale, Choice, Unknown, placed
from backsight.types import Array

SMALL, COARSE = 1e-5, 1e-3
"""Steps of derivatives: of lanes, which share all rounding; of windows, and runs of their own."""

ENOUGH = 400
"""Samples of a half from which on halves are compared."""


@dataclasses.dataclass(frozen=True)
class Tuning:
    """Estimator, model and data of a fit."""

    estimator: AbstractEstimator
    model: Model
    data: tuple[Data, ...]
    periods: tuple[float, ...]
    criterion: AbstractCriterion
    searching: Search

    def search(
        self, objective: Objective, *, restarts: int, seed: int
    ) -> tuple[Optimum, list[float]]:
        """Best values, and by how much other ends of the search are worse."""
        start = self.searching.evaluate(objective, np.zeros(len(objective.coordinates)))
        if not np.isfinite(start.cost):
            raise TuningError(
                f"{self.estimator.title} fails with the start values: its innovations are not "
                "finite; start nearer to the truth, or with more noise"
            )
        near, again = (NEAR, restarts) if objective.fast else (ROUGHLY, 0)
        return search_all(objective, self.searching, restarts=again, seed=seed, near=near)

    def option(
        self,
        choices: Sequence[Choice],
        unknowns: Sequence[Unknown],
        objective: Objective,
        place: Array,
    ) -> tuple[Candidate, xr.Dataset]:
        """Best option of all choices with the values found; its estimator has the start values."""
        candidates = candidates_of(self.estimator, choices)
        model = self.model
        trials = candidates
        if unknowns:
            if any(u.per != "all" for u in unknowns):
                raise TuningError("a Choice goes with values that all recordings share")
            values = objective.values(place, 0)
            pairs = [placed(c.estimator, self.model, unknowns, values) for c in candidates]
            trials = [
                dataclasses.replace(c, estimator=p[0])
                for c, p in zip(candidates, pairs, strict=True)
            ]
            model = pairs[0][1]
        able = able_settings(self.estimator)
        open_to_inputs = tuple(c.name for c in choices if c.name in able)
        halving = Halving(open_to_inputs, model, self.periods, self.criterion)
        best, table = halve(trials, halving, self.data)
        return next(c for c in candidates if c.options == best.options), table

    def tuned(
        self,
        unknowns: Sequence[Unknown],
        objective: Objective,
        place: Array,
        worse: Sequence[float],
        *,
        check: bool,
    ) -> Tuned:
        """What was found, judged."""
        coordinates = objective.coordinates
        if unknowns:
            near = NEAR if objective.fast else ROUGHLY
            best = descend(objective, place, self.searching, near=near)
        else:
            best = Optimum(place, objective.at(place), True)
        names = [c.name for c in coordinates]
        covariance, ratio = spread_of(best.evaluation)
        slopes = np.array(
            [c.unknown.scale.slope(float(t)) for c, t in zip(coordinates, best.place, strict=True)]
        )
        size = np.sqrt(np.diag(covariance)) * np.abs(slopes)
        profiles = profiles_of(objective, best, covariance) if check and names else None
        halves = self._halves(objective, best) if check and names and objective.fast else None
        doubts = doubts_of(objective, best, covariance, ratio, profiles)
        doubts += doubts_of_search(best, worse, self.searching.passes)
        inflated = 1.0 if self.criterion.independent else float((ratio**2).max(initial=1.0))
        doubts += doubts_of_halves(halves, len(names), inflated=inflated) if halves else []
        doubts += self._of_simulation(unknowns, objective, best) if check else []
        ends = [
            placed(self.estimator, self.model, unknowns, objective.values(best.place, k))
            for k in range(len(self.data))
        ]
        scales = [c.unknown.scale for c in coordinates]
        return Tuned(
            estimators=tuple(e for e, _ in ends),
            models=tuple(m for _, m in ends),
            late=tuple(
                delays_of(self.model, unknowns, objective.values(best.place, k))
                for k in range(len(self.data))
            ),
            values={
                n: s.value(float(t)) for n, s, t in zip(names, scales, best.place, strict=True)
            },
            start={c.name: c.unknown.start for c in coordinates},
            std=dict(zip(names, map(float, size), strict=True)),
            units={c.name: c.unknown.unit for c in coordinates},
            correlation=correlation_of(names, covariance),
            chosen={},
            cost=best.evaluation.data.cost,
            before=best.evaluation.data.cost,
            measured=int(sum((d[4] > 0).sum() for d in self.data)),
            doubts=tuple(doubts),
            held_out=halves,
            profiles=profiles,
            history=self._history(names, scales),
            choices=None,
            passes=self.searching.passes,
            converged=best.converged,
        )

    def _of_simulation(
        self, unknowns: Sequence[Unknown], objective: Objective, best: Optimum
    ) -> list[str]:
        """Sentences on how a simulation with the parameters found would do."""
        shared = all(u.per == "all" for u in unknowns)
        bent = any(u.kind == "parameter" for u in unknowns)
        ready = shared and bent and objective.fast and not self.criterion.simulates
        if not ready or self.searching.exhausted or self.model.driven or self.estimator.horizon:
            return []
        found = placed(self.estimator, self.model, unknowns, objective.values(best.place, 0))
        free = unknowns_of_simulation(*found, tuple(unknowns), recordings=len(self.data))
        outliers = self.criterion.outliers if isinstance(self.criterion, Likelihood) else 0.0
        criterion = Simulation(outliers=outliers)
        data = tuple((u, y, mask, y, mask) for u, y, mask, *_ in self.data)
        other = dataclasses.replace(
            self, estimator=found[0], model=found[1], criterion=criterion, data=data
        )
        return doubts_of_simulation(other.objective(free))

    def _history(self, names: list[str], scales: Sequence[AbstractScale]) -> xr.Dataset:
        history = self.searching.history
        values = [
            [s.value(float(t)) for s, t in zip(scales, place, strict=True)]
            for _, _, place in history
        ]
        return xr.Dataset(
            {
                "cost": ("evaluation", np.array([cost for _, cost, _ in history])),
                "passes": ("evaluation", np.array([done for done, _, _ in history])),
                "value": (
                    ("evaluation", "name"),
                    np.array(values).reshape(len(history), len(names)),
                ),
            },
            coords={"name": names},
        )

    def _halves(self, objective: Objective, best: Optimum) -> HeldOut | None:
        """How values of the first halves do in the second."""
        if self.searching.exhausted or min(len(d[0]) for d in self.data) < 2 * ENOUGH:
            return None
        first = objective.cut(lambda n: slice(0, n // 2))
        second = objective.cut(lambda n: slice(n // 2, None))
        found = descend(first, best.place, self.searching, near=ROUGHLY)
        start = np.zeros(len(best.place))
        return HeldOut(*second.cost_at([start, found.place, best.place]))

    def objective(self, unknowns: Sequence[Unknown]) -> Objective:
        """Criterion and prior over all recordings."""
        estimator = self.estimator
        if self.criterion.simulates:
            if any(u.kind in ("walk", "sigma_x0", "P0") or u.matrix for u in unknowns):
                raise TuningError(
                    "a simulation has no process noise and no prior: free parameters, start "
                    "values and sigma_y"
                )
            estimator = simulating(estimator, self.model)
        known: dict[float, Runner] = {}
        for dt in self.periods:
            if dt not in known:
                given, ahead = (estimator, self.model, dt), self.criterion.alone
                own = [d for d, t in zip(self.data, self.periods, strict=True) if t == dt]
                quick = quick_runner(*given, unknowns, data=own, ahead=ahead) if unknowns else None
                rebuilt = Rebuilt(estimator, self.model, tuple(unknowns), dt, ahead)
                known[dt] = quick or rebuilt
        runners = tuple(known[dt] for dt in self.periods)
        fast = not any(isinstance(r, Rebuilt) for r in runners)
        if any(u.late_output for u in unknowns) and not fast:
            raise TuningError(
                f"{self.estimator.title} cannot find the delay of one output of several: tune an "
                "EKF"
            )
        # What iterates to a tolerance has derivatives no better than that.
        smooth = fast and not self.estimator.horizon
        return Objective(
            runners,
            self.data,
            coordinates_of(unknowns, len(self.data)),
            self.criterion,
            SMALL if smooth else COARSE,
            fast,
        )

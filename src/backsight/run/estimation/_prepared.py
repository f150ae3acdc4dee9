"""What is made of an estimator and a model before a recording is seen, and kept for the next one.

Tracing, differentiating and looking for the integration step take many times as long as a short
recording. All of it follows from estimator, model and sampling period alone.
"""

from __future__ import annotations

import dataclasses
import functools
from typing import TYPE_CHECKING

from backsight.description import Kept, content
from backsight.discrete.runge_kutta import Integrator
from backsight.engine.building import built_alone
from backsight.engine.recursion import Channel, Recursion
from backsight.estimators.around.misled import watched
from backsight.estimators.base import AbstractEstimator
from backsight.models.model import Model
from backsight.run.estimation.results.outputs import JUDGED, Outputs, putting_out

if TYPE_CHECKING:
    import xarray as xr

KEPT = 32
"""Number of recursions that are kept."""


@dataclasses.dataclass(frozen=True, eq=False)
class Prepared:
    """A compiled estimator, equal to itself only: what is made of it is found by it.

    Parameters
    ----------
    recursion : Recursion
        Puts out what is kept of a result, see `putting_out`.
    integrator : Integrator, optional
        How the model is carried from sample to sample, see `AbstractEstimator.chosen`.
    model : Model
    kept : tuple of Channel
        Of its outputs, those of a result.
    """

    recursion: Recursion
    integrator: Integrator | None
    model: Model
    kept: tuple[Channel, ...]

    @functools.cached_property
    def coordinates(self) -> xr.Coordinates:
        """Names and units along the dimensions of the result."""
        # What runs live has no result, and shall not wait for xarray.
        from backsight.run.estimation.results.result import coordinates

        return coordinates(self.model, self.kept)


def compile_once(
    estimator: AbstractEstimator,
    model: Model,
    dt: float,
    *,
    outputs: Outputs,
    restart: bool = False,
    needed: tuple[str, ...] = JUDGED,
) -> Prepared:
    """Compile an estimator, or take what was made of the same descriptions before.

    Beside the `outputs` it puts out what is `needed`, if there is such a thing.

    Raises
    ------
    TuningError, ModelError
        If the estimator does not fit the model, or has no such outputs.
    """
    # With the method itself: reloading in a notebook changes it inside the same class.
    key = content(estimator, model, dt, outputs.variables, restart, needed, type(estimator).build)

    @built_alone
    def make() -> Prepared:
        recursion = watched(estimator.compile(model, dt), estimator, model)
        visible = putting_out(recursion.restarting() if restart else recursion, outputs, needed)
        return Prepared(
            recursion=visible,
            integrator=estimator.chosen(model, dt),
            model=model,
            kept=tuple(c for c in visible.channels if outputs.keeps(c.name)),
        )

    return _made.of(key, make)


_made: Kept[Prepared] = Kept(KEPT)

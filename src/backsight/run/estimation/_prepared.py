"""What is made of an estimator and a model before a recording is seen, and kept for the next one.

Tracing, differentiating and looking for the integration step take many times as long as a short
recording. All of it follows from estimator, model and sampling period alone.
"""

import collections
import dataclasses
import threading
from collections.abc import Hashable

import xarray as xr

from backsight.description import content
from backsight.discrete.runge_kutta import Integrator
from backsight.engine.recursion import Recursion
from backsight.estimators.around.misled import watched
from backsight.estimators.base import AbstractEstimator
from backsight.models.model import Model
from backsight.run.estimation.results.outputs import JUDGED, Outputs, putting_out
from backsight.run.estimation.results.result import coordinates

KEPT = 32
"""Number of recursions that are kept; the one not used for the longest time goes first."""


@dataclasses.dataclass(frozen=True, eq=False)
class Prepared:
    """A compiled estimator, equal to itself only: what is made of it is found by it.

    Parameters
    ----------
    recursion : Recursion
        Puts out what is kept of a result, see `putting_out`.
    integrator : Integrator, optional
        How the model is carried from sample to sample, see `AbstractEstimator.chosen`.
    coordinates : xarray.Coordinates
        Names and units along the dimensions of the result.
    """

    recursion: Recursion
    integrator: Integrator | None
    coordinates: xr.Coordinates


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
    with _lock:
        if key is not None and key in _made:
            _made.move_to_end(key)
            return _made[key]
    recursion = watched(estimator.compile(model, dt), estimator, model)
    visible = putting_out(recursion.restarting() if restart else recursion, outputs, needed)
    kept = [c for c in visible.channels if outputs.keeps(c.name)]
    made = Prepared(
        recursion=visible,
        integrator=estimator.chosen(model, dt),
        coordinates=coordinates(model, kept),
    )
    if key is not None:
        with _lock:
            _made[key] = made
            while len(_made) > KEPT:
                _made.popitem(last=False)
    return made


_made: collections.OrderedDict[Hashable, Prepared] = collections.OrderedDict()
_lock = threading.Lock()

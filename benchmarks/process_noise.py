"""Moving horizon estimation with process noise on all states: the problem and its windows."""

import dataclasses
import functools

import numpy as np

from backsight.discrete.runge_kutta import Integrator
from backsight.engine import native
from backsight.estimators import EKF, MHE, ConstantArrival, Noise, SmoothedArrival
from backsight.models.model import Model
from backsight.solvers.box import GaussNewton
from backsight.types import Array
from benchmarks.contest import Contender
from benchmarks.ours import expected
from benchmarks.problems import TWICE, Problem, chain
from benchmarks.stage import HORIZON, PRIOR, STEPPING, joint_model, stage
from benchmarks.windows import PLACES

HEUN = Integrator("heun", substeps=4)

FREE, INACTIVE, ACTIVE = "no bounds", "bounds that are inactive", "an active bound"

BOUNDS: dict[str, dict[str, float]] = {
    FREE: {},
    INACTIVE: {"k": 0.0, "b": 0.0, "c": 0.0},
    ACTIVE: {"c": 0.70 * 8e5},
}
"""Least values of stiffness, damping and gain per mass; the last is more than the true gain."""


def model(bounds: str) -> Model:
    """The stage with one of the `BOUNDS`, which the first guess satisfies."""
    joint, states = joint_model(), []
    for s in joint.states:
        least = BOUNDS[bounds].get(s.name, -np.inf)
        states.append(dataclasses.replace(s, lower=least, value=max(s.value, least)))
    return dataclasses.replace(joint, states=tuple(states))


@functools.cache
def problem(bounds: str, optimiser: GaussNewton = TWICE, *, N: int = HORIZON) -> Problem:
    """Moving horizon estimator of the stage: 6 states, 4 Heun sub-steps, constant arrival cost.

    An active bound acts until the payload is taken off: the recording ends there.
    """
    mhe = MHE(STEPPING, PRIOR, N=N, arrival=ConstantArrival(), integrator=HEUN, optimiser=optimiser)
    recording = stage().isel(time=slice(2000)) if bounds == ACTIVE else stage()
    return Problem(mhe, model(bounds), recording)


@dataclasses.dataclass(frozen=True)
class Window:
    """Minimise the cost over the states of a window; all in scaled variables.

    Parameters
    ----------
    x_bar : (nx,) array
        A-priori estimate of the first state; its covariance is that of the prior.
    U, Y : (N + 1,) arrays
        Inputs and outputs.
    guess : (N + 1, nx) array
        Solution of the window before, one sample on.
    """

    x_bar: Array
    U: Array
    Y: Array
    guess: Array


@functools.cache
def windows(bounds: str) -> tuple[Window, ...]:
    """Windows of the recording as the converged estimator meets them."""
    of = problem(bounds, GaussNewton())
    s, N = of.setting, of.estimator.N
    look = of.estimator.inspect(of.model, s.dt).solve
    u, y = of.data[0] / s.su, of.data[1] / s.sy
    made = []
    for place in places(bounds):
        carry, _ = native.run(
            of.recursion, [d[: place - 1] for d in of.data], carry=of.recursion.carry0
        )
        last = [d[place - 1] for d in of.data]
        before = np.asarray(look(carry, *last)[1]).T / s.sx
        carry, _ = native.run(of.recursion, [d[None] for d in last], carry=carry)
        here = slice(place - N, place + 1)
        made.append(
            Window(
                # The memory begins with the arrival cost of the coming window.
                x_bar=carry[: s.model.nx],
                U=u[here, 0],
                Y=y[here, 0],
                guess=np.vstack([before[1:], before[-1:]]),
            )
        )
    return tuple(made)


def places(bounds: str) -> list[int]:
    """Newest sample of every window."""
    return [place for place in PLACES if place < len(problem(bounds).data[0])]


def native_engine(bounds: str, optimiser: GaussNewton, minimisers: Array) -> Contender:
    """The whole recording, all of a sample counted; shows its estimates at the `places`."""
    of, chosen = problem(bounds, optimiser), places(bounds)
    native.compiled(of.recursion)

    def work() -> Array:
        _, outputs = native.run(of.recursion, of.data, carry=of.recursion.carry0)
        return outputs[0][chosen] / of.setting.sx

    return Contender(work, len(of.data[0]), minimisers)


def large() -> Contender:
    """A row of masses with 30 states; linear, so that the Kalman filter is to be met."""
    row = chain(15, samples=100)
    filtering = row.estimator
    noise = Noise(sigma_y=1e-3, sigma_w=1e-2)
    mhe = MHE(
        noise,
        filtering.prior,
        N=20,
        arrival=SmoothedArrival(),
        integrator=filtering.integrator,
        optimiser=TWICE,
    )
    of = dataclasses.replace(row, estimator=mhe)
    native.compiled(of.recursion)

    def work() -> Array:
        _, outputs = native.run(of.recursion, of.data, carry=of.recursion.carry0)
        return outputs[0] / of.setting.sx

    kalman = EKF(noise, filtering.prior, filtering.integrator, covariance="discrete")
    return Contender(work, len(of.data[0]), expected(dataclasses.replace(row, estimator=kalman)))

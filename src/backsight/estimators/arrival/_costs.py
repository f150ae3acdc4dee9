"""Every arrival cost: from none to a Kalman filter that sees what the window sees."""

import dataclasses
from collections.abc import Iterator
from typing import Annotated

import casadi as ca
import numpy as np

from backsight.description import Called, Positive, Sound, alike
from backsight.estimators.arrival._base import AbstractArrival, Arrival, Fitting, Leaving
from backsight.estimators.kalman import ekf, ukf
from backsight.estimators.kalman.exact_sensors import with_exact_sensors
from backsight.estimators.kalman.sigma_points import points_of
from backsight.estimators.kalman.square_root import WIDE, width_of_prior
from backsight.estimators.parts.filtering import Halves
from backsight.estimators.scaled import Setting
from backsight.estimators.uncertainty import covariance, covariance_faults
from backsight.schema import Innovations
from backsight.solvers.trajectory import Chain, transit, update
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class NoArrival(AbstractArrival):
    """Nothing from before the window counts.

    Where the window does not determine a direction, the guess stays in it. Done as a proximal
    point: the guess is a prior with `width` times the standard deviation of the estimator's prior,
    and goes along with every iteration, so that its weight vanishes when they converge.

    Parameters
    ----------
    width : float
        Also the size of what the covariance says of directions that are not determined. Less is
        taken of a prior that is wide by itself.

    Examples
    --------
    >>> bs.settings.NoArrival(width=100.0).width
    100.0
    """

    width: Annotated[Positive, Called("the width of the prior")] = 1e3

    @property
    def innovations(self) -> Innovations:
        """See `AbstractArrival.innovations`."""
        return "coloured"

    def build(self, to: Fitting) -> Arrival:
        """See `AbstractArrival.build`."""
        # A covariance does not hold both the noise and a prior more than a million times as wide.
        width = min(self.width, max(1.0, WIDE / max(width_of_prior(to.s), 1.0)))
        wide = ca.MX(to.chain.stored(to.s.P0) * width**2)
        return Arrival(
            spread0=to.chain.stored(to.s.P0),
            covariance=_same(to.chain),
            advance=lambda _x, _P, leaving: [leaving.x_next, wide],
            free=True,
        )


@dataclasses.dataclass(frozen=True)
class ConstantArrival(AbstractArrival):
    """The estimate of the last window with a constant covariance, as is done most often.

    The estimate has seen the data still in the window: they count twice. No Kalman filter, not even
    for linear models.

    Parameters
    ----------
    P : (nx, nx) array, optional
        Covariance of the first sample, physical units; by default the estimator's prior.

    Examples
    --------
    >>> import numpy as np
    >>> bs.settings.ConstantArrival(P=np.diag([1e-6, 1e-2])).P.shape
    (2, 2)
    """

    P: Array | None = None

    @property
    def innovations(self) -> Innovations:
        """See `AbstractArrival.innovations`."""
        return "coloured"

    def conflicts(self, sound: Sound) -> Iterator[str]:
        """See `Description.conflicts`."""
        if self.P is not None and sound("P"):
            yield from covariance_faults(self.P, what="P", singular=True)

    def scaled(self, s: Setting) -> Array:
        """The covariance in scaled variables, (nx, nx)."""
        if self.P is None:
            return s.P0
        checked = covariance(self.P, s.model.states, what="P of the arrival cost", singular=True)
        return checked / np.outer(s.sx, s.sx)

    def build(self, to: Fitting) -> Arrival:
        """See `AbstractArrival.build`."""
        constant = ca.MX(to.chain.stored(self.scaled(to.s)))
        return Arrival(
            spread0=to.chain.stored(to.s.P0),
            covariance=_same(to.chain),
            advance=lambda _x, _P, leaving: [leaving.x_next, constant],
        )


@dataclasses.dataclass(frozen=True)
class EKFArrival(AbstractArrival):
    """An extended Kalman filter that runs N samples behind the present.

    Examples
    --------
    >>> bs.settings.EKFArrival()
    EKFArrival()
    """

    def build(self, to: Fitting) -> Arrival:
        """See `AbstractArrival.build`."""
        halves = with_exact_sensors(to.s, ekf.ekf_halves(to.s, to.integrator, "discrete"))
        return _filter(halves, to.s.P0, _same(to.chain))


@dataclasses.dataclass(frozen=True)
class UKFArrival(AbstractArrival):
    """An unscented Kalman filter that runs N samples behind the present.

    Parameters
    ----------
    alpha, beta, kappa : float
        See `UKF`.

    Examples
    --------
    >>> bs.settings.UKFArrival().alpha
    1.0
    """

    alpha: Positive = 1.0
    beta: float = 2.0
    kappa: float = 0.0

    def build(self, to: Fitting) -> Arrival:
        """See `AbstractArrival.build`."""
        points = points_of(to.s, alpha=self.alpha, beta=self.beta, kappa=self.kappa)
        halves = with_exact_sensors(to.s, ukf.ukf_halves(to.s, to.integrator, points))
        return _filter(halves, to.s.P0, _whole(to.chain, halves.covariance))


@dataclasses.dataclass(frozen=True)
class SmoothedArrival(AbstractArrival):
    """A Kalman filter step linearised along the trajectory that the whole window sees.

    ``P`` is corrected with the sample that leaves and carried to the next one with the derivatives
    at the smoothed states, the mean accordingly: data that stay in the window decide where to
    linearise but do not count. Equal to the smoothed information of the next sample minus that of
    the data still in the window, without a difference being taken.

    Parameters
    ----------
    naive : bool
        Take mean and covariance of the next sample given the whole window: its data then count
        again and again, and the covariance becomes too small.

    Examples
    --------
    >>> bs.settings.SmoothedArrival().naive
    False
    """

    naive: bool = False

    @property
    def innovations(self) -> Innovations:
        """See `AbstractArrival.innovations`."""
        return "coloured" if self.naive else "white"

    def build(self, to: Fitting) -> Arrival:
        """See `AbstractArrival.build`."""
        step, walk = _along(to.chain, to.Q), ca.MX(to.chain.stored(to.Q - to.chain.Q))

        def once(x: ca.MX, P: ca.MX, leaving: Leaving) -> list[ca.MX]:
            along = [leaving.along, leaving.along_next]
            return step.call([x, P, *along, *leaving.stage, *leaving.stage_next])

        return Arrival(
            spread0=to.chain.stored(to.s.P0),
            covariance=_same(to.chain),
            advance=(lambda _x, _P, now: [now.x_next, now.P_next() + walk]) if self.naive else once,
        )


ARRIVALS: dict[str, AbstractArrival] = {
    "NoArrival": NoArrival(),
    "ConstantArrival": ConstantArrival(),
    "EKFArrival": EKFArrival(),
    "UKFArrival": UKFArrival(),
    "SmoothedArrival": SmoothedArrival(),
    "SmoothedArrival(naive)": SmoothedArrival(naive=True),
}
"""What is tried in the place of an arrival cost, by its name."""


def arrival_name(arrival: AbstractArrival) -> str:
    """Its name in `ARRIVALS`, or what it prints as."""
    return next((name for name, part in ARRIVALS.items() if alike(part, arrival)), str(arrival))


def _filter(halves: Halves, P0: Array, covariance: ca.Function) -> Arrival:
    """Correct with the sample that leaves, carry to the next one."""

    def advance(x: ca.MX, spread: ca.MX, leaving: Leaving) -> list[ca.MX]:
        measured = [leaving.u, leaving.y, leaving.mask]
        x_post, after, _ = halves.correct.call([x, spread, *measured])
        return halves.predict.call([x_post, after, leaving.u, leaving.u_next])

    return Arrival(halves.spread_of(P0), covariance, advance)


def _along(chain: Chain, Q: Array) -> ca.Function:
    """Kalman filter step with given derivatives; of the limits only sensors without noise."""
    nx, kept = chain.nx, list(chain.exact)
    rows = ca.DM(chain.A, 1.0)[kept, :].sparsity()
    free = dataclasses.replace(
        chain,
        Q=Q,
        noise=np.zeros((len(kept), nx)),
        A=rows,
        softness=chain.softness[kept],
        slack=chain.slack[kept],
        exact=tuple(range(len(kept))),
    )
    x, P = ca.MX.sym("x", nx), ca.MX.sym("P", chain.size_P)
    first, second = ca.MX.sym("first", nx), ca.MX.sym("second", nx)
    stages = [[ca.MX.sym(k, size) for k, size in chain.sizes.items()] for _ in range(2)]
    exact = _exact_rows(chain, rows)
    none, n = ca.MX.zeros(len(kept)), len(kept)
    now, then = ([*stage[:5], *exact(*stage[5:]), none, none] for stage in stages)
    # Where the window begins nothing has moved: the transition only tells sizes.
    begun = [x - first, P, none, ca.MX.zeros(nx, n), none, none]
    begun = transit(free)(*begun[:2], *now) if n else begun
    d, P_post, *_ = update(free)(*begun, *now)
    d_next, P_next, *_ = transit(free)(d, P_post, *then)
    return ca.Function(
        "along", [x, P, first, second, *stages[0], *stages[1]], [second + d_next, P_next]
    )


def _exact_rows(chain: Chain, rows: ca.Sparsity) -> ca.Function:
    """``(A, low, high)`` of a sample to those of sensors without noise."""
    kept = list(chain.exact)
    A = ca.SX.sym("A", chain.A.nnz())
    low, high = ca.SX.sym("low", chain.n), ca.SX.sym("high", chain.n)
    found = ca.project(ca.SX(chain.A, A)[kept, :], rows)
    results = [ca.vec(found.nz[:]), low[kept], high[kept]]
    return ca.Function("exact_rows", [A, low, high], [ca.densify(r) for r in results])


def _whole(chain: Chain, covariance: ca.Function) -> ca.Function:
    """The covariance as the window stores it, from the one as its lower triangle."""
    if not chain.dense:
        return covariance
    spread = ca.MX.sym("spread", covariance.numel_in(0))
    return ca.Function("whole_covariance", [spread], [chain.whole()(covariance(spread))])


def _same(chain: Chain) -> ca.Function:
    P = ca.MX.sym("P", chain.size_P)
    return ca.Function("covariance", [P], [P])

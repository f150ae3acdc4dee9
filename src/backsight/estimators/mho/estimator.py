"""Moving horizon observer: nonlinear least squares over a window, between two Kalman filters."""

import dataclasses
from typing import ClassVar, Literal

import casadi as ca
import numpy as np

from backsight.description import Horizon, NonNegative
from backsight.discrete.runge_kutta import Integrator
from backsight.engine.loops import scan
from backsight.engine.recursion import Channel, Recursion
from backsight.estimators.base import ESTIMATE_CHANNELS, AbstractEstimator
from backsight.estimators.kalman.ekf import correct, innovation
from backsight.estimators.kalman.prediction import Propagation, predict
from backsight.estimators.kalman.square_root import refuse_too_wide
from backsight.estimators.mho._cost import window_cost
from backsight.estimators.mho._covariance import Errors, no_errors, true_covariance
from backsight.estimators.mho._linearised import (
    Corrections,
    LinearisedSteps,
    corrections,
    variation,
)
from backsight.estimators.parts.covariance import Covariance
from backsight.estimators.parts.factors import cholesky
from backsight.estimators.parts.filtering import choose, data_inputs, physical
from backsight.estimators.parts.flags import FLAGS, Flags
from backsight.estimators.parts.leaf import half, leaf, notation
from backsight.estimators.parts.memory import Memory
from backsight.estimators.parts.window import moved_on, no_window
from backsight.estimators.scaled import Setting, setting
from backsight.estimators.uncertainty import Noise, Prior
from backsight.models.model import Model
from backsight.solvers.box import GaussNewton, QuasiNewton


@dataclasses.dataclass(frozen=True)
class MHO(AbstractEstimator):
    r"""Moving horizon observer.

    Every sample t it estimates the state at the start of the window t - N ... t:

    1. pre-filter: an EKF step at t - N gives :math:`\bar x` and P (eq. 29-31);
    2. optimiser: with exact sensitivities and the bounds of the model it minimises

       .. math:: J(x) = (x - \bar x)' P^{-1} (x - \bar x)
          + \alpha \sum_{i=0}^{N} e_i' R^{-1} e_i, \qquad e_i = y_{t-N+i} - h(x_i, u_{t-N+i}),

       where :math:`x_i` is the model's response from x without process noise (eq. 26-28);
    3. post-filter: an EKF runs from there through the window to the present (eq. 32).

    For one output J is the cost of eq. 26 with S = R P^-1 (eq. 43), divided by R: with alpha = 1
    prior and measurements have their statistical weights, with alpha = 0 the result is exactly the
    extended Kalman filter. Until the window is full it is the extended Kalman filter, too; the
    window begins at the first sample in which anything was measured.

    Parameters
    ----------
    noise : Noise
    prior : Prior
    N : int
        Horizon in sampling periods; the window holds N + 1 samples.
    alpha : float
        Weight of the measurements in the window.
    integrator : Integrator
        For continuous-time models.
    covariance : {"transition", "ode", "discrete"}
        See `EKF`.
    optimiser : GaussNewton
        When the iterations end.
    bands : {"true", "filters"}
        Covariance P of the estimate. The observer uses a measurement again and again: in the
        filters, and in the cost of every window. ``true`` follows what the noise of the window does
        to the estimate by all these ways, to first order, and holds for every alpha; without bounds
        it is exact for linear models. ``filters`` is the P of the post-filter, as in the paper, and
        takes less time: it is too small, by far with a large alpha. The estimate is the same.

    Notes
    -----
    ``x_start`` and ``P_start`` are the optimiser's estimate at the start of the
    window and its covariance, active bounds included.

    References
    ----------
    Polóni, Eielsen, Rohaľ-Ilkiv, Johansen, "Moving horizon observer for vibration dynamics with
    plant uncertainties in nanopositioning system estimation", ACC 2012, section IV.

    Examples
    --------
    >>> noise, prior = bs.Noise(sigma_y=1e-3, sigma_w=1e-4), bs.Prior(sigma_x0=1.0)
    >>> mho = bs.MHO(noise, prior, N=10, alpha=1e-3)
    >>> mho.N, mho.alpha
    (10, 0.001)
    """

    key: ClassVar[str] = "mho"
    title: ClassVar[str] = "Moving horizon observer"
    weighs: ClassVar[bool] = True
    noise_states: ClassVar[bool] = True
    varies_noise: ClassVar[tuple[str, ...]] = ("Q",)
    varied_settings: ClassVar[tuple[str, ...]] = ("alpha",)

    noise: Noise
    prior: Prior
    N: Horizon = 15
    alpha: NonNegative = 1.0
    integrator: Integrator = dataclasses.field(default_factory=Integrator)
    covariance: Propagation = "transition"
    optimiser: GaussNewton | QuasiNewton = dataclasses.field(default_factory=GaussNewton)
    bands: Literal["true", "filters"] = "true"

    @property
    def judges_steps(self) -> bool:
        """See `AbstractEstimator.judges_steps`."""
        return isinstance(self.optimiser, GaussNewton) and self.optimiser.tolerance > 0

    def build(self, model: Model, dt: float) -> Recursion:
        """See `AbstractEstimator.build`."""
        s = setting(model, dt, noise=self.noise, prior=self.prior, integrator=self.integrator)
        refuse_too_wide(s, "MHO")
        N = self.N
        kept = Covariance(s.model.nx)
        tracked = self.bands == "true" and self.alpha > 0
        data = data_inputs(s)
        u, y, mask = s.enter()(*data)
        m = Memory(
            x_start=s.x0,
            P_start=kept.kept(s.P0),
            x_last=s.x0,
            P_last=kept.kept(s.P0),
            **no_window(s, N + 1),
            present=np.zeros((1, N + 1)),
            called=0,
            **(no_errors(s, N) if tracked else {}),
        )
        time_update = predict(s, s.integrator, self.covariance)
        update = correct(s, check=self.covariance == "ode")

        # The new sample enters the window, which begins at the first measurement.
        here = _begins(s)(m.present[N], mask)
        U, Y, M, present = moved_on((m.U, m.Y, m.M, m.present), (u, y, mask, here))
        full = present[0]
        last = [m.x_last, m.P_last]
        prior = choose(m.called, time_update.call([*last, U[:, N - 1], u]), last)
        x_start, P_start = choose(m.present[N], [m.x_start, m.P_start], prior)
        e, S = innovation(s)(*prior, u, y, mask)

        # 1. pre-filter, eq. 29-31
        x_bar, P_bar, flags = update(x_start, P_start, U[:, 0], Y[:, 0], full * M[:, 0])

        # 2. optimiser, eq. 26-28
        cost = window_cost(s, s.integrator, N=N, alpha=self.alpha)
        minimise = self.optimiser.minimiser(
            cost, lower=s.lower, upper=s.upper, cost_unit=float(np.mean(np.diag(s.R)))
        )
        found = minimise(full, x_bar, _factor(s)(P_bar), U, Y, M)
        x, Sigma, iterations, limit, rejected = found

        # 3. post-filter, eq. 32
        (x_now, P_now, flags), passed = scan(
            _post_filter(s, time_update, update),
            N,
            carry=[x, P_bar, flags],
            xs=[U[:, :-1], U[:, 1:], Y[:, 1:], M[:, 1:], present[:, :-1], present[:, 1:]],
        )
        raised = dataclasses.replace(Flags.of(flags), iteration_limit=limit, step_rejected=rejected)

        # covariance with everything that was used more than once
        errors: dict[str, ca.MX] = {}
        if tracked:
            steps = self._steps(s, (U, M), (x_start, P_start), passed, Sigma)
            (P_alone,) = choose(m.present[0], [m.P_alone], [P_start])
            before = Errors(P_alone, m.by_v, m.by_w)
            P_true, after = true_covariance(s, before, steps, u, N=N, alpha=self.alpha)
            (P_now,) = choose(full, [P_true], [P_now])
            found = choose(full, [after.P, after.V, after.W], [P_alone, m.by_v, m.by_w])
            errors = dict(zip(("P_alone", "by_v", "by_w"), found, strict=True))

        # 4. start of the next window, eq. 29
        ahead = time_update.call([x, P_bar, U[:, 0], U[:, 1]])
        x_start, P_start = choose(full, ahead, [x_start, P_start])
        estimate = physical(
            s, x=x_now, P=kept.triangle()(P_now), u=u, e=e, S=S, flags=raised.vector()
        )
        x_window, P_window = _physical_start(s)(x, Sigma)
        return m.recursion(
            self.key,
            data,
            next={
                "x_start": x_start,
                "P_start": P_start,
                "x_last": x_now,
                "P_last": P_now,
                "U": U,
                "Y": Y,
                "M": M,
                "present": present,
                "called": 1,
                **errors,
            },
            outputs=estimate | {"iterations": iterations, "x_start": x_window, "P_start": P_window},
            channels=CHANNELS,
            dt=dt,
        )

    def _steps(
        self,
        s: Setting,
        window: tuple[ca.MX, ca.MX],
        start: tuple[ca.MX, ca.MX],
        passed: list[ca.MX],
        Sigma: ca.MX,
    ) -> LinearisedSteps:
        """Linearise pre-filter, window and post-filter at the states that they `passed`."""
        U, M = window
        seen = corrections(s)
        first = Corrections(*seen.call([*start, U[:, 0], M[:, 0]]))
        before, prior, P_prior = passed
        _, later = scan(seen, self.N, carry=[], xs=[prior, P_prior, U[:, 1:], M[:, 1:]])
        varied = variation(s, s.integrator, self.covariance)
        _, (Phi, Q) = scan(varied, self.N, carry=[], xs=[before, U[:, :-1], U[:, 1:]])
        return LinearisedSteps(first, Phi, Q, Corrections(*later), Sigma)


CHANNELS = (
    *ESTIMATE_CHANNELS,
    Channel("iterations"),
    Channel("x_start", ("state",)),
    Channel("P_start", ("state", "state_"), symmetric=True),
)
"""Beside the estimate: iterations of the optimiser, and its result at the start of the window."""


def _begins(s: Setting) -> ca.Function:
    """1 from the first sample in which anything was measured."""
    sizes = {**notation(s), "began": 1}
    return leaf("begins", sizes, lambda began, mask: {"here": ca.fmax(began, ca.mmax(mask > 0))})


def _factor(s: Setting) -> ca.Function:
    """Lower factor of a covariance."""
    return half("factor", s, lambda P: {"L": ca.densify(cholesky(P))})


def _post_filter(s: Setting, predict: ca.Function, correct: ca.Function) -> ca.Function:
    """Step i of the post-filter, eq. 32; samples before the start of the data change nothing.

    Beside what it carries on it shows the states before and after the prediction, and P there.
    """
    m = s.model
    sizes = {
        "x": m.nx, "P": Covariance(m.nx).size, "flags": FLAGS, "u_last": m.nu, "u": m.nu,
        "y": m.ny, "mask": m.ny, "before": 1, "here": 1,
    }  # fmt: skip
    k = {name: ca.MX.sym(name, size) for name, size in sizes.items()}
    predicted = predict.call([k["x"], k["P"], k["u_last"], k["u"]])
    prior = choose(k["before"], predicted, [k["x"], k["P"]])
    x_post, P_post, raised = correct(*prior, k["u"], k["y"], k["here"] * k["mask"])
    flags = _merged()(k["flags"], raised)
    passed = [k["x"], *prior]
    return ca.Function("post_filter", list(k.values()), [x_post, P_post, flags, *passed])


def _merged() -> ca.Function:
    """Flags of the window so far and of its next sample.

    Clipping is reported of the present sample only, a covariance that fails of the whole window.
    """
    so_far, now = ca.SX.sym("so_far", FLAGS), ca.SX.sym("now", FLAGS)
    a, b = Flags.of(so_far), Flags.of(now)
    failed = ca.fmax(a.not_positive_definite, b.not_positive_definite)
    merged = dataclasses.replace(b, not_positive_definite=failed)
    return ca.Function("merge_flags", [so_far, now], [merged.vector()])


def _physical_start(s: Setting) -> ca.Function:
    """State and covariance at the start of the window in physical units."""
    scales = ca.SX(np.outer(s.sx, s.sx))
    return leaf("physical_start", notation(s), lambda x, P: {"x": ca.SX(s.sx) * x, "P": P * scales})

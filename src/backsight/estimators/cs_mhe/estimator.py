"""Compressive-sensing moving horizon estimation: states and sparse unknown forces."""

import dataclasses
import math
from collections.abc import Iterator, Mapping
from typing import Annotated, ClassVar, Literal, TypeAlias, get_args

from backsight.description import (
    Called,
    Count,
    Distinct,
    Horizon,
    Lag,
    NonNegative,
    PositiveOrInfinite,
    Range,
    Sound,
)
from backsight.discrete.runge_kutta import Hold
from backsight.engine.recursion import Recursion
from backsight.errors import TuningError
from backsight.estimators.arrival import SmoothedArrival, arrival_name
from backsight.estimators.base import AbstractEstimator
from backsight.estimators.cs_mhe._along import MOTION, STAGES, Along, directions, varying_tables
from backsight.estimators.cs_mhe._arrival import LinearArrival, arrival_faults
from backsight.estimators.cs_mhe._limits import (
    NO_LIMIT,
    by_force,
    caps,
    check_unlimited,
    sides,
    sign_faults,
)
from backsight.estimators.cs_mhe._step import cs_recursion
from backsight.estimators.cs_mhe._tables import (
    check_forces,
    shapes_within,
    tables,
    with_forces_as_inputs,
)
from backsight.estimators.cs_mhe._window import KERNEL, Solver
from backsight.estimators.cs_mhe.carryover import Carryover
from backsight.estimators.cs_mhe.refinement import Refinement, faults_of, groups_of
from backsight.estimators.dictionaries import Dictionary, Impulses
from backsight.estimators.force_estimator import AbstractForceEstimator, Forced
from backsight.estimators.kalman.square_root import refuse_too_wide
from backsight.estimators.parts.limits import Limit, limits_of, names_used_twice
from backsight.estimators.parts.linear import at_mean, linear
from backsight.estimators.parts.window import lag_faults
from backsight.estimators.uncertainty import Noise, Prior
from backsight.models.lti import is_linear
from backsight.models.model import Model
from backsight.models.sampling import check_sampling
from backsight.schema import Innovations
from backsight.types import Array, ByName

Correction: TypeAlias = Literal["none", "amplitude", "energy"]
CORRECTIONS = get_args(Correction)


@dataclasses.dataclass(frozen=True)
class CompressiveSensingMHE(AbstractForceEstimator):
    r"""Compressive-sensing moving horizon estimator.

    For models with forces d at more places than there are sensors, of which few act at a time. In
    the window k - N ... k it finds the states, and the factors :math:`\alpha` of the atoms of which
    the forces consist, :math:`d_i = \sum_s \Psi_s \alpha_{i-s}`, that minimise (eq. 8-14)

    .. math:: (x_{k-N} - \bar x)' \bar P^{-1} (x_{k-N} - \bar x) + \sum_i w_i' Q^{-1} w_i
        + \sum_i v_i' R^{-1} v_i + \lambda \sum_i \|\alpha_i\|_1,

        x_{i+1} = A x_i + B u_i + E d_i + w_i, \qquad y_i = C x_i + D u_i + F d_i + v_i .

    There is no factor 1/2: :math:`\lambda` is that of the paper. Of a nonlinear model windows are
    linearised along the motion that was found (Gauss-Newton, eq. 9-10).

    Parameters
    ----------
    noise : Noise
        Of the sensors; process noise is added to that of `sigma_force`.
    prior : Prior
        Of the state at the first sample.
    forces : tuple of str
        Parameters of the model that are unknown forces, with the value 0.
    lam : float
        Weight of the l1 norm [1 / unit of the forces]; with infinity no force is found.
    N : int
        Horizon in sampling periods; the window holds N + 1 samples.
    sigma_force : dict or number
        Standard deviation per sample of the part of the forces that is not looked for, white:
        :math:`Q = E\,\mathrm{diag}(\sigma^2) E'`. It stands for the error of the model.
    dictionary : Impulses, HalfSines, Haversines, Splines, Decays, SteadyLoads, MovingLoads or Atoms
        Of which pulses the forces are made.
    nonnegative, nonpositive : tuple of str
        Forces with a known sign.
    largest : dict or number
        Largest size of a force's factors, :math:`\alpha_i \in \Gamma_i`.
    limits : tuple of Limit
        Bounds on sums of states, residuals or process noise at every sample of the window
        (:math:`X, V, W` of eq. 14), beside the bounds of the states in the model.
    arrival : SmoothedArrival, ConstantArrival or NoArrival
        What :math:`\bar x, \bar P` are once the window is full, as for `MHE`: the Kalman filter's
        prediction, which takes from the window only the forces found; with `naive=True` the
        window's own, which counts measurements twice (the paper's); one with constant P; nothing.
    carryover : Carryover, optional
        Expect the forces of a window in the next one, too (Algorithm 1).
    refinement : Reweighting or Exchanges, optional
        What follows the l1 norm in a window: weights that shrink, or the number of forces in
        place of their sizes. Not with limits or a `carryover`.
    threshold : float
        Smallest factor that counts as a force, in `d_hat` and for the carryover.
    correction : {"none", "amplitude", "energy"}
        Spread what is below the threshold over what is above it, in `d_hat`: so that the sum of
        the magnitudes of the window is kept, or the sum of the squares.
    bias : {"removed", "kept"}
        The l1 norm finds forces, and makes them too small. With ``removed`` the forces found are
        shown as least squares in which the others stay zero, while `threshold` judges them by the
        l1 norm; deviations, of states too, count what the l1 norm had taken away, and atoms that
        could as well have been chosen. ``kept`` shows the optimum itself, as in the paper.
    lag : int or "N"
        The estimate of a sample is made when `lag` more have been measured, with "N" from the
        start of the window: the newest forces cannot be told apart yet.
    hold : {"zoh", "foh"}
        Known inputs between samples: held, or, of a linear model, interpolated; forces are held.
    passes : int
        Of a nonlinear model: how often a window is linearised; every sample is in N + 1 windows.
    max_steps, max_active : int, optional
        For hard real time: most steps of the active set in one window, and most factors that are
        not zero; by default so many as suffice. Beyond, the status says *iteration limit*.

    Notes
    -----
    Results have the variables ``d_hat`` (time, force), the force from this sample to the next;
    ``d_raw``, the same without threshold and correction; ``d_std``, its standard deviation, 0
    where no force was found; ``nonzeros`` and ``steps`` of the active set; ``kkt``, the largest
    violation of the optimality conditions of (the last) l1 norm as a share of lam, 1e-9 or more;
    ``gap``, its duality gap as a share of the cost, 1e-10 or more: the optimum is not lower by more
    (above 1e-9 the status says *not optimal*); ``lam_max``, the weight that would find nothing.

    Covariances of the states are those of the least-squares problem in which the forces that are
    zero stay zero and the others are free; with ``SmoothedArrival(naive=True)`` and ``bias="kept"``
    they are too small. If limits contradict each other, the estimate is the one without them, the
    status says *infeasible*, and ``infeasible`` names them.

    Raises
    ------
    EngineError, TuningError
        If the C kernels of the package are not compiled, or a setting is wrong.

    References
    ----------
    Kirchner, Croes, Cosco, Desmet, "Exploiting input sparsity for joint state/input moving horizon
    estimation", 2018, doi:10.1016/j.ymssp.2017.08.024. Lee, Battle, Raina, Ng, "Efficient sparse
    coding algorithms", 2007, Advances in Neural Information Processing Systems 19.

    Examples
    --------
    >>> noise, prior = bs.Noise(sigma_y=1e-3, sigma_w=1e-6), bs.Prior(sigma_x0=1e-3)
    >>> bs.CompressiveSensingMHE(noise, prior, forces=("hit",), lam=20.0, N=8).lam
    20.0
    """

    key: ClassVar[str] = "csmhe"
    title: ClassVar[str] = "Compressive-sensing moving horizon estimator"
    kernels: ClassVar[tuple[str, ...]] = (KERNEL, STAGES, MOTION)
    weighs: ClassVar[bool] = True
    seeks_surprises: ClassVar[bool] = True
    varies_noise: ClassVar[tuple[str, ...]] = ("Q",)

    noise: Noise
    prior: Prior
    forces: Annotated[tuple[str, ...], Distinct()]
    lam: PositiveOrInfinite
    N: Horizon = 10
    sigma_force: Annotated[ByName, Range("not be negative", 0.0)] = 0.0
    dictionary: Dictionary = dataclasses.field(default_factory=Impulses)
    nonnegative: Annotated[tuple[str, ...], Distinct()] = ()
    nonpositive: Annotated[tuple[str, ...], Distinct()] = ()
    largest: Annotated[ByName, Range("be positive", 0.0, above=True, infinite=True)] = math.inf
    limits: tuple[Limit, ...] = ()
    arrival: Annotated[LinearArrival, Called("the arrival cost")] = dataclasses.field(
        default_factory=SmoothedArrival
    )
    carryover: Carryover | None = None
    refinement: Refinement | None = None
    threshold: NonNegative = 0.0
    correction: Correction = "none"
    bias: Literal["removed", "kept"] = "removed"
    lag: Lag = "N"
    hold: Hold = "zoh"
    passes: Count = 1
    max_steps: Count | None = None
    max_active: Count | None = None

    def conflicts(self, sound: Sound) -> Iterator[str]:
        """See `Description.conflicts`."""
        if sound("lag", "N"):
            yield from lag_faults(self.lag, self.N)
        if sound("arrival"):
            yield from arrival_faults(self.arrival)
        if sound("limits"):
            yield from names_used_twice(self.limits)
        if sound("forces", "nonnegative", "nonpositive"):
            yield from sign_faults(self.forces, self.nonnegative, self.nonpositive)
        if sound("refinement", "limits", "largest"):
            yield from faults_of(self.refinement, self.limits, self.largest, self.carryover)

    @property
    def innovations(self) -> Innovations:
        """See `AbstractEstimator.innovations`."""
        return "forced"

    def variants(self) -> Mapping[str, AbstractEstimator]:
        """See `AbstractEstimator.variants`: only itself, by its arrival cost."""
        return {arrival_name(self.arrival): self}

    def build(self, model: Model, dt: float) -> Recursion:
        """See `AbstractEstimator.build`."""
        bent = not is_linear(self._joined(model))
        forced = self._linearised(model, dt) if bent else self._forced(model, dt)
        refuse_too_wide(forced.system.s, "CompressiveSensingMHE")
        onto = directions(forced) if bent else None
        solver = self._solver(forced, onto)
        along = None if onto is None else Along(solver, onto, self.passes)
        return cs_recursion(self.key, solver, self.carryover, along)

    def forced(self, model: Model, dt: float) -> Forced:
        """See `AbstractForceEstimator.forced`; there is nothing that would keep limits."""
        check_unlimited(model, self.limits, self.largest)
        return self._forced(model, dt)

    def _forced(self, model: Model, dt: float) -> Forced:
        joined = self._joined(model)
        system = linear(joined, dt, noise=self.noise, prior=self.prior, hold=self.hold)
        check_sampling(joined, dt)
        forced = Forced.of(system, self.background(model), self.forces)
        check_forces(forced, self.N)
        return forced

    def linearised(self, model: Model, dt: float) -> Forced:
        """See `AbstractForceEstimator.linearised`."""
        check_unlimited(model, self.limits, self.largest)
        return self._linearised(model, dt)

    def _linearised(self, model: Model, dt: float) -> Forced:
        if self.hold != "zoh":
            raise TuningError("hold 'foh' needs a linear model; use 'zoh'")
        system = at_mean(self._joined(model), dt, noise=self.noise, prior=self.prior)
        return Forced.of(system, self.background(model), self.forces)

    def _joined(self, model: Model) -> Model:
        """The model with its unknown forces as the last inputs."""
        joined = with_forces_as_inputs(model, self.forces)
        if (rule := self.outliers) is not None and (problem := self.unfit_for(rule)):
            raise TuningError(problem)
        if self.noise.beyond_additive:
            raise TuningError(f"{self.title} takes additive noise of constant size only")
        return joined

    def background(self, model: Model) -> Array:
        """See `AbstractEstimator.background`: `sigma_force`."""
        known = {s.name: s for s in model.parameters}
        forces = [known[name] for name in self.forces]
        return by_force("sigma_force", self.sigma_force, forces, otherwise=0.0)

    def _solver(self, forced: Forced, onto: Array | None) -> Solver:
        shapes = shapes_within(self.dictionary, len(self.forces), self.N)
        limits = limits_of(forced.system.s, forced.noise, self.limits, {})
        if onto is None:
            found = tables(forced, shapes, limits, N=self.N, lag=self.delay)
        else:
            found = varying_tables(forced, shapes, onto, N=self.N)
        return Solver(
            forced=forced,
            tables=found,
            shapes=shapes,
            N=self.N,
            lag=self.delay,
            lam=min(self.lam, NO_LIMIT),
            side=self.sides(),
            threshold=self.threshold,
            arrival=self.arrival,
            correction=CORRECTIONS.index(self.correction),
            carries=self.carryover is not None,
            refits=self.bias == "removed",
            limits=limits,
            caps=caps(self.largest, forced.signals, self.dictionary, self.carryover),
            at_most=(self.max_steps, self.max_active),
            refinement=self.refinement,
            group=groups_of(self.refinement, self.forces, self.dictionary, found.steps, limits),
        )

    def weighted(self, lam: float) -> "CompressiveSensingMHE":
        """See `AbstractForceEstimator.weighted`."""
        return dataclasses.replace(self, lam=lam, threshold=0.0, carryover=None, refinement=None)

    def sides(self) -> Array:
        """See `AbstractForceEstimator.sides`."""
        return sides(self.forces, self.nonnegative, self.nonpositive, self.dictionary)

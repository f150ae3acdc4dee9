"""What is known before the data: noise of the process and the sensors, and the prior."""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated

import numpy as np

from backsight.description import Description, Range, Sound
from backsight.errors import ModelError, TuningError
from backsight.estimators.outliers import Gate, Huber, StudentT
from backsight.models.model import Model
from backsight.models.signals import Signal, vector
from backsight.types import Array, ByName


@dataclasses.dataclass(frozen=True)
class Noise(Description):
    """Process noise and measurement noise, physical units.

    `sigma_w` and `Q` are what is added once per sample, to continuous models as to discrete ones.
    `Qc` is noise that acts all the time; what it adds in a sampling period follows from the model.

    Parameters
    ----------
    sigma_y : dict, sequence or number
        Standard deviation of every output per sample, 0 without noise. Or give `R`.
    R : (ny, ny) array
        Covariance of the measurement noise per sample; may be singular.
    sigma_w : dict, sequence or number
        Standard deviation by which every state walks at random per sample; states that a dict
        leaves out do not walk. Or give `Q` or `Qc`.
    Q : (nx, nx) array
        Covariance of the process noise per sample; may be singular, is never inverted.
    Qc : (nx, nx) array
        Spectral density of the process noise of a continuous-time model [unit^2/s].
    sigma_u : dict, sequence or number, optional
        Standard deviation of inputs that were measured with noise, held over the sample like the
        input itself; inputs that a dict leaves out are exact.
    sigma_p : dict, optional
        Parameters of the model that are white noise to their standard deviation: in every sample a
        new value around that of the parameter, in f and h alike. For noise that is not additive.
    cross : (nx, ny) array, optional
        Covariance E[w v'] of process and measurement noise of the same sample.
    outliers : Gate, StudentT or Huber, optional
        How samples that do not belong are kept from the estimate, see
        `backsight.estimators.outliers`; by default all are believed.

    Raises
    ------
    TuningError
        If not exactly one of ``sigma_y, R`` is given or more than one of ``sigma_w, Q, Qc``.

    Examples
    --------
    >>> bs.Noise(sigma_y={"y": 1e-3}, sigma_w={"q": 0.0, "v": 1e-2}).sigma_w
    {'q': 0.0, 'v': 0.01}
    """

    sigma_y: Annotated[ByName | None, Range("not be negative", 0.0)] = None
    sigma_w: Annotated[ByName | None, Range("not be negative", 0.0)] = None
    R: Array | None = None
    Q: Array | None = None
    Qc: Array | None = None
    sigma_u: Annotated[ByName | None, Range("not be negative", 0.0)] = None
    sigma_p: Annotated[Mapping[str, float] | None, Range("not be negative", 0.0)] = None
    cross: Array | None = None
    outliers: Gate | StudentT | Huber | None = None

    def conflicts(self, sound: Sound) -> Iterator[str]:
        """See `Description.conflicts`."""
        if (self.sigma_y is None) == (self.R is None):
            yield "measurement noise: give either sigma_y or R"
        if sum(q is not None for q in (self.sigma_w, self.Q, self.Qc)) > 1:
            yield "process noise: give only one of sigma_w, Q, Qc"
        for what, given in (("R", self.R), ("Q", self.Q), ("Qc", self.Qc)):
            if given is not None and sound(what):
                yield from covariance_faults(given, what=what, singular=True)

    @property
    def beyond_additive(self) -> tuple[str, ...]:
        """Names of the fields that make noise states, see `around.noise_states`."""
        return tuple(n for n in ("sigma_u", "sigma_p", "cross") if getattr(self, n) is not None)

    def of_inputs(self, model: Model) -> Array:
        """Standard deviation of every input, (nu,)."""
        given = {} if self.sigma_u is None else self.sigma_u
        return np.sqrt(np.diag(_diagonal(given, model.inputs, what="sigma_u", missing=0.0)))

    def of_parameters(self, model: Model) -> Array:
        """Standard deviation of every parameter as white noise."""
        given = {} if self.sigma_p is None else self.sigma_p
        return np.sqrt(np.diag(_diagonal(given, model.parameters, what="sigma_p", missing=0.0)))

    def per_sample(self, model: Model) -> Array:
        """Covariance of the process noise per sample, (nx, nx), of `sigma_w` or `Q` alone."""
        if self.Qc is not None:
            raise TuningError(
                f"{', '.join(self.beyond_additive)} goes with process noise per sample: give "
                "sigma_w or Q instead of Qc"
            )
        return self.stated_process(model)

    def measurement(self, model: Model, *, singular: bool = False) -> Array:
        r"""R, (ny, ny), checked against the model, with the rounding of outputs.

        Sensors without noise are refused unless R may be `singular`. A reading in steps of q is
        wrong by up to half a step: noise with the variance :math:`q^2 / 12` if the signal moves by
        more than a step from sample to sample (Widrow, Kollár, "Quantization Noise", 2008,
        doi:10.1017/CBO9780511754661).
        """
        steps = [0.0 if s.resolution is None else s.resolution for s in model.outputs]
        if self.R is None:
            of_sensors = _diagonal(self.sigma_y, model.outputs, what="sigma_y", missing=None)
        else:
            of_sensors = covariance(self.R, model.outputs, what="R", singular=True)
        R = of_sensors + np.diag(np.array(steps) ** 2 / 12)
        if not singular and any(covariance_faults(R, what="R", singular=False)):
            exact = [s.name for s, v in zip(model.outputs, np.diag(R), strict=True) if v == 0]
            of = f"'{exact[0]}'" if exact else "a combination of outputs"
            raise TuningError(
                f"{of} has no noise (sigma_y = 0, a singular R): that is for MHE, LinearMHE, "
                "RecursiveMHE with alpha = 0, JointInput, KalmanFilter with constant matrices, "
                "EKF, IEKF and UKF, and what smooths these; give it a small sigma_y"
            )
        return R

    def process(self, model: Model) -> Array:
        """Covariance that is added per sample, (nx, nx), with what the model itself has.

        Zero if `Qc` is given.
        """
        stated = self.stated_process(model)
        return stated if model.continuous else stated + model.noise_of_its_own()

    def stated_process(self, model: Model) -> Array:
        """What `Q` or `sigma_w` add per sample, (nx, nx), without what the model itself has."""
        if self.Q is not None:
            return covariance(self.Q, model.states, what="Q", singular=True)
        given = {} if self.sigma_w is None else self.sigma_w
        return _diagonal(given, model.states, what="sigma_w", missing=0.0)

    def density(self, model: Model) -> Array:
        """Spectral density of a continuous-time model, (nx, nx), with what the model itself has."""
        stated = self.stated_density(model)
        return stated + model.noise_of_its_own() if model.continuous else stated

    def stated_density(self, model: Model) -> Array:
        """`Qc`, (nx, nx), without what the model itself has; zero unless it is given."""
        if self.Qc is None:
            return np.zeros((model.nx, model.nx))
        if not model.continuous:
            raise TuningError("Qc is a spectral density; a discrete-time model needs Q")
        return covariance(self.Qc, model.states, what="Qc", singular=True)


@dataclasses.dataclass(frozen=True)
class Prior(Description):
    """What is known of the state before the first measurement, physical units.

    Parameters
    ----------
    sigma_x0 : dict, sequence or number
        Standard deviation of every state. Or give `P0`. States of a force with dynamics, which a
        dict leaves out or which get the same number as all, have the stationary covariance of the
        force.
    P0 : (nx, nx) array
        Covariance of the state; may be singular.
    x0 : dict, sequence or number, optional
        Mean; states that a dict leaves out take the value in the model (0 for a state, the value
        of the parameter for a parameter).

    Examples
    --------
    >>> bs.Prior(sigma_x0={"q": 1.0, "v": 10.0}, x0={"q": 0.5}).mean(bs.sdof(k=40.0, b=0.8))
    array([0.5, 0. ])
    """

    sigma_x0: Annotated[ByName | None, Range("not be negative", 0.0)] = None
    x0: ByName | None = None
    P0: Array | None = None

    def conflicts(self, sound: Sound) -> Iterator[str]:
        """See `Description.conflicts`."""
        if (self.sigma_x0 is None) == (self.P0 is None):
            yield "prior: give either sigma_x0 or P0"
        if self.P0 is not None and sound("P0"):
            yield from covariance_faults(self.P0, what="P0", singular=True)

    def mean(self, model: Model) -> Array:
        """x0, (nx,), checked against the model and its bounds."""
        values = np.array([s.value for s in model.states])
        x0 = _vector({} if self.x0 is None else self.x0, model.states, "x0", values)
        outside = [
            f"'{s.name}' starts at {v:g}, outside {s.lower:g} to {s.upper:g}"
            for s, v in zip(model.states, x0, strict=True)
            if not s.lower <= v <= s.upper
        ]
        if outside or not np.all(np.isfinite(x0)):
            raise TuningError("x0: " + "; ".join(outside or ["has an entry that is not finite"]))
        return x0

    def covariance(self, model: Model) -> Array:
        """P0, (nx, nx), checked against the model."""
        if self.P0 is None:
            return self._diagonal_with_forces(model)
        return covariance(self.P0, model.states, what="P0", singular=True)

    def _diagonal_with_forces(self, model: Model) -> Array:
        given = self.sigma_x0
        named = set(given) if isinstance(given, Mapping) else set()
        at_rest = [
            group
            for group in model.driven
            if isinstance(given, Mapping | int | float) and named.isdisjoint(group.states)
        ]
        spread = {
            name: float(np.sqrt(v))
            for group in at_rest
            for name, v in zip(group.states, group.stationary.diagonal(), strict=True)
        }
        if isinstance(given, Mapping):
            given = {**given, **spread}
        P = _diagonal(given, model.states, what="sigma_x0", missing=None)
        for group in at_rest:
            places = [model.index(name) for name in group.states]
            P[np.ix_(places, places)] = group.stationary
        return P


def covariance(given: Array, of: Sequence[Signal], *, what: str, singular: bool) -> Array:
    """Check size, symmetry and definiteness; raises `TuningError` with the smallest eigenvalue.

    Eigenvalues of n states are known to n times the machine precision of the largest one; what is
    below that is rounding, as in ``Q = b b'`` of many states.
    """
    matrix = np.asarray(given, float)
    n = len(of)
    if matrix.shape != (n, n):
        names = ", ".join(s.name for s in of)
        raise TuningError(f"{what} has the shape {matrix.shape}; it must be {(n, n)} for {names}")
    for message in covariance_faults(matrix, what=what, singular=singular):
        raise TuningError(message)
    return (matrix + matrix.T) / 2


def covariance_faults(given: Array, *, what: str, singular: bool) -> Iterator[str]:
    """Say why a matrix is no covariance, whatever it is of."""
    matrix = np.asarray(given, float)
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1]:
        yield f"{what} has the shape {matrix.shape}; a covariance is a square matrix"
        return
    if not np.all(np.isfinite(matrix)):
        yield f"{what} has an entry that is not finite"
        return
    size = np.sqrt(np.abs(np.diag(matrix)))
    size[size == 0] = 1.0
    with np.errstate(over="ignore"):
        relative = matrix / np.outer(size, size)
    if not np.all(np.isfinite(relative)):
        yield f"{what} is not positive: entries are far larger than their variances"
        return
    if not np.allclose(relative, relative.T, rtol=0, atol=1e-9):
        yield f"{what} is not symmetric"
        return
    values = np.linalg.eigvalsh((relative + relative.T) / 2)
    smallest, largest = float(values.min(initial=1.0)), float(values.max(initial=0.0))
    rounding = len(relative) * np.finfo(float).eps * largest
    if smallest < -max(1e-12, rounding) or (smallest <= max(1e-14, rounding) and not singular):
        eigenvalue = float(np.linalg.eigvalsh((matrix + matrix.T) / 2)[0])
        wanted = "positive semidefinite" if singular else "positive definite"
        yield f"{what} is not {wanted}: its smallest eigenvalue is {eigenvalue:.3g}"


LARGEST = 1e150
"""Standard deviation whose square is still a number."""


def _diagonal(
    given: ByName | None, of: Sequence[Signal], *, what: str, missing: float | None
) -> Array:
    default = np.full(len(of), np.nan if missing is None else missing)
    sigma = _vector(given if given is not None else {}, of, what, default)
    lacking = [s.name for s, v in zip(of, sigma, strict=True) if np.isnan(v)]
    if lacking:
        raise TuningError(f"{what} gives no standard deviation for {', '.join(lacking)}")
    large = [f"{s.name} = {v:g}" for s, v in zip(of, sigma, strict=True) if not v < LARGEST]
    if large:
        raise TuningError(f"{what} is too large for its square to be a number: {', '.join(large)}")
    small = [f"{s.name} = {v:g}" for s, v in zip(of, sigma, strict=True) if 0 < v < 1 / LARGEST]
    if small:
        raise TuningError(f"{what} is too small for its square to be a number: {', '.join(small)}")
    return np.diag(sigma**2)


def _vector(given: ByName, of: Sequence[Signal], what: str, default: Array) -> Array:
    try:
        return vector(given, of, what=what, default=default)
    except ModelError as error:
        raise TuningError(str(error)) from None

r"""Unknown forces with dynamics: linear systems that white noise drives, in their stationary state.

A force that is a random walk has no size: nothing says how large it becomes. A stationary process
has one, and a time or a frequency in which it changes. All of these are

.. math:: \dot z = F(u)\,z + w, \qquad E[w w'] = Q_c\,\delta(t), \qquad
    F P_\infty + P_\infty F' + Q_c = 0,

and the force itself is the first entry of z. Sources: Hartikainen, Särkkä, "Kalman filtering and
smoothing solutions to temporal Gaussian process regression models", 2010,
doi:10.1109/MLSP.2010.5589113; for periodic ones Solin, Särkkä, "Explicit link between periodic
covariance functions and state space models", 2014, PMLR 33, and for the orders of a rotating
machine Vold, Leuridan, "High resolution order tracking at extreme slew rates using Kalman tracking
filters", 1993, doi:10.4271/931288.
"""

import abc
import dataclasses
import math
from typing import Annotated, Literal

import casadi as ca
import numpy as np
import scipy

from backsight.description import (
    Called,
    Description,
    Distinct,
    Positive,
    PositiveOrInfinite,
    Range,
)
from backsight.models.signals import Named
from backsight.types import Array

Order = Annotated[float, Range("be positive", 0.0, above=True)]
Smoothness = Literal["1/2", "3/2", "5/2"]
"""How often a Matérn process can be differentiated, and half of it: 0, 1 and 2 times."""


@dataclasses.dataclass(frozen=True)
class Process(Description, abc.ABC):
    """A stationary process; `augment` makes an unknown force follow it."""

    @property
    @abc.abstractmethod
    def endings(self) -> tuple[str, ...]:
        """What the names of its states add to that of the force; the first adds nothing."""

    @property
    @abc.abstractmethod
    def stationary(self) -> Array:
        """Covariance of its states at any time, (n, n)."""

    @property
    @abc.abstractmethod
    def density(self) -> Array:
        """Spectral density of the white noise that drives it, (n, n)."""

    @abc.abstractmethod
    def rates(self, z: ca.SX, u: Named) -> ca.SX:
        """F(u) z."""

    @abc.abstractmethod
    def ahead(self, z: ca.SX, u: Named, *, dt: float) -> tuple[ca.SX, Array]:
        """State a sampling period later without noise, and the covariance of the noise."""

    @property
    @abc.abstractmethod
    def words(self) -> str:
        """What it is, in a few words."""

    @property
    def input_needed(self) -> str | None:
        """Name of the input that it follows."""
        return None


@dataclasses.dataclass(frozen=True)
class Matern(Process):
    r"""A process with the covariance function of Matérn: smooth on a scale of time.

    .. math:: k(\tau) = \sigma^2 e^{-s}, \quad \sigma^2 (1 + s) e^{-s}, \quad
        \sigma^2 (1 + s + s^2 / 3) e^{-s}, \qquad s = \sqrt{2 \nu}\,|\tau| / l

    for :math:`\nu` = 1/2, 3/2, 5/2.

    Parameters
    ----------
    sigma : float
        Standard deviation of the force [its unit].
    length : float
        Scale of time l [s].
    smoothness : {"1/2", "3/2", "5/2"}
        :math:`\nu`; 1/2 is the process of Gauss and Markov, see `GaussMarkov`.

    Examples
    --------
    >>> bs.forces.Matern(sigma=5.0, length=0.2).smoothness
    '3/2'
    """

    sigma: Positive
    length: Annotated[Positive, Called("length", "s")]
    smoothness: Smoothness = "3/2"

    @property
    def endings(self) -> tuple[str, ...]:
        """See `Process.endings`."""
        return ("", "_rate", "_rate2")[: self._size]

    @property
    def words(self) -> str:
        """See `Process.words`."""
        return f"Matérn {self.smoothness}, ± {self.sigma:g}, {self.length:g} s"

    @property
    def _size(self) -> int:
        return {"1/2": 1, "3/2": 2, "5/2": 3}[self.smoothness]

    @property
    def _decay(self) -> float:
        return math.sqrt(2 * self._size - 1) / self.length

    @property
    def _matrix(self) -> Array:
        """Of rates: the characteristic polynomial is (s + decay)**n."""
        n = self._size
        F = np.eye(n, k=1)
        F[-1] = [-math.comb(n, k) * self._decay ** (n - k) for k in range(n)]
        return F

    @property
    def stationary(self) -> Array:
        """See `Process.stationary`."""
        a, s2 = self._decay, self.sigma**2
        if self._size < 3:
            return np.diag([s2, a**2 * s2][: self._size])
        k = a**2 * s2 / 3
        return np.array([[s2, 0, -k], [0, k, 0], [-k, 0, a**4 * s2]])

    @property
    def density(self) -> Array:
        """See `Process.density`."""
        n = self._size
        q = np.zeros((n, n))
        q[-1, -1] = self.sigma**2 * {1: 2.0, 2: 4.0, 3: 16 / 3}[n] * self._decay ** (2 * n - 1)
        return q

    def rates(self, z: ca.SX, u: Named) -> ca.SX:
        """See `Process.rates`."""
        del u
        return ca.sparsify(ca.DM(self._matrix)) @ z

    def ahead(self, z: ca.SX, u: Named, *, dt: float) -> tuple[ca.SX, Array]:
        """See `Process.ahead`."""
        del u
        Phi = np.asarray(scipy.linalg.expm(self._matrix * dt), float)
        return ca.DM(Phi) @ z, _kept_stationary(self.stationary, Phi)


def GaussMarkov(sigma: float, time: float) -> Matern:
    r"""Process of Gauss and Markov (Ornstein-Uhlenbeck): :math:`\dot d = -d / T + w`.

    Its covariance function is :math:`\sigma^2 e^{-|\tau| / T}`.

    Parameters
    ----------
    sigma : float
        Standard deviation of the force [its unit].
    time : float
        Time constant T in which it forgets [s].

    Examples
    --------
    >>> bs.forces.GaussMarkov(sigma=5.0, time=0.1)
    Matern(sigma=5.0, length=0.1, smoothness='1/2')
    """
    return Matern(sigma, time, "1/2")


@dataclasses.dataclass(frozen=True)
class Periodic(Process):
    r"""A sum of sines at multiples of a frequency, whose amplitudes and phases may drift.

    .. math:: k(\tau) = \sum_m \frac{\sigma^2}{n} e^{-|\tau| / T} \cos(2 \pi f m \tau)

    over the n `orders` m. With a frequency that is recorded the model changes with its inputs, and
    is still linear in its states.

    Parameters
    ----------
    sigma : float
        Standard deviation of the force [its unit], all orders together.
    frequency : float or str
        f [Hz]; or the name of an input that is the frequency [Hz], as of a shaft whose speed
        changes.
    orders : tuple of float
        Multiples of the frequency.
    memory : float
        Time T in which amplitudes and phases are forgotten [s]; infinity for those that stay.

    Examples
    --------
    >>> bs.forces.Periodic(sigma=2.0, frequency=25.0, orders=(1.0, 2.0)).orders
    (1.0, 2.0)
    """

    sigma: Positive
    frequency: Positive | str
    orders: Annotated[tuple[Order, ...], Distinct(), Called("orders")] = (1.0,)
    memory: PositiveOrInfinite = math.inf

    @property
    def endings(self) -> tuple[str, ...]:
        """See `Process.endings`: the force, a quadrature, and both of the other orders."""
        labels = [f"_order{m:g}".replace(".", "_").replace("-", "_") for m in self.orders]
        pairs = [(label, f"{label}_quadrature") for label in labels]
        return ("", *[name for pair in pairs for name in pair][1:])

    @property
    def words(self) -> str:
        """See `Process.words`."""
        at = self.frequency if isinstance(self.frequency, str) else f"{self.frequency:g} Hz"
        listed = ", ".join(f"{m:g}" for m in self.orders)
        return f"orders {listed} of {at}, ± {self.sigma:g}, memory {self.memory:g} s"

    @property
    def _mixing(self) -> Array:
        """From sines and their quadratures to the states, of which the first is the sum."""
        T = np.eye(2 * len(self.orders))
        T[0, ::2] = 1.0
        return T

    @property
    def stationary(self) -> Array:
        """See `Process.stationary`."""
        return self.sigma**2 / len(self.orders) * self._mixing @ self._mixing.T

    @property
    def density(self) -> Array:
        """See `Process.density`."""
        return 2 / self.memory * self.stationary

    @property
    def input_needed(self) -> str | None:
        """See `Process.input_needed`."""
        return self.frequency if isinstance(self.frequency, str) else None

    def _omega(self, u: Named) -> ca.SX:
        given = self.frequency
        return 2 * math.pi * (u[given] if isinstance(given, str) else ca.SX(given))

    def rates(self, z: ca.SX, u: Named) -> ca.SX:
        """See `Process.rates`."""
        omega = self._omega(u)
        turning = ca.diagcat(*(m * omega * ca.DM([[0, -1], [1, 0]]) for m in self.orders))
        T, back = ca.DM(self._mixing), ca.DM(np.linalg.inv(self._mixing))
        return T @ turning @ back @ z - z / self.memory

    def ahead(self, z: ca.SX, u: Named, *, dt: float) -> tuple[ca.SX, Array]:
        """See `Process.ahead`."""
        angles = [m * self._omega(u) * dt for m in self.orders]
        turned = ca.diagcat(
            *(ca.vertcat(ca.horzcat(ca.cos(a), -ca.sin(a)), ca.horzcat(ca.sin(a), ca.cos(a)))
              for a in angles)
        )  # fmt: skip
        T, back = ca.DM(self._mixing), ca.DM(np.linalg.inv(self._mixing))
        kept = math.exp(-dt / self.memory)
        return kept * (T @ turned @ back @ z), (1 - kept**2) * self.stationary


def _kept_stationary(P: Array, Phi: Array) -> Array:
    """Covariance of the noise that keeps P stationary: P - Phi P Phi'."""
    Q = P - Phi @ P @ Phi.T
    return (Q + Q.T) / 2

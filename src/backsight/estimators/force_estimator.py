"""What methods for sparse forces over whole recordings need of an estimator of such forces."""

import abc
import dataclasses
from collections.abc import Sequence

import numpy as np

from backsight.description import Description
from backsight.errors import TuningError, nearest
from backsight.estimators.base import AbstractEstimator
from backsight.estimators.parts.linear import Linear
from backsight.estimators.uncertainty import Noise
from backsight.models.model import Model
from backsight.models.signals import Signal
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class AbstractDictionary(Description, abc.ABC):
    r"""Atoms that begin at every step of the window.

    The forces over the steps, held between the samples, are
    :math:`d_k = \sum_s \Psi_s \alpha_{k-s}`.
    """

    @abc.abstractmethod
    def shapes(self, forces: int) -> Array:
        """Psi as an array (forces, steps, atoms).

        Raises
        ------
        TuningError
            If the dictionary is not one for so many forces.
        """

    def force_of(self, forces: int) -> list[int]:
        """Which force every atom belongs to; -1 if it moves several."""
        touched = np.abs(self.shapes(forces)).max(axis=1) > 0
        alone = touched.sum(axis=0) == 1
        return np.where(alone, touched.argmax(axis=0), -1).tolist()


@dataclasses.dataclass(frozen=True)
class Forced:
    r"""A linear model with unknown forces d, and how large they are in the background.

    .. math:: x_{k+1} = A x_k + B u_k + E d_k + w_k, \qquad y_k = C x_k + D u_k + F d_k + v_k

    Parameters
    ----------
    system : Linear
        The forces are its last inputs.
    E, F : (nx, nf), (ny, nf) arrays
        Of forces in their own unit to scaled states and outputs.
    sigma : (nf,) array
        Standard deviation of the background forces [their unit].
    names : tuple of str
    """

    system: Linear
    E: Array
    F: Array
    sigma: Array
    names: tuple[str, ...]

    @classmethod
    def of(cls, system: Linear, sigma: Array, names: tuple[str, ...]) -> "Forced":
        """Take the last inputs of a system for the forces."""
        m, unit = len(names), system.s.su[-len(names) :]
        E, F = (system.B + system.B_next)[:, -m:], system.D[:, -m:]
        return cls(system, E / unit, F / unit, sigma, names)

    @property
    def nu(self) -> int:
        """Number of known inputs."""
        return self.system.s.model.nu - len(self.names)

    @property
    def signals(self) -> tuple[Signal, ...]:
        """The forces as inputs of the model."""
        return self.system.s.model.inputs[self.nu :]

    @property
    def noise(self) -> Array:
        """Covariance of all process noise of a sample with that of the background, scaled."""
        background = self.E * self.sigma
        return self.system.s.Q + background @ background.T

    @property
    def direct(self) -> bool:
        """Whether outputs contain the forces of their own sample."""
        return bool(self.F.any())


class AbstractForceEstimator(AbstractEstimator):
    """An estimator of sparse unknown forces; what is tuned and searched for is what it says here.

    Attributes
    ----------
    noise : Noise
    forces : tuple of str
        Parameters of the model that are unknown forces.
    lam : float
        Weight of the l1 norm.
    threshold : float
        Smaller forces are not shown.
    dictionary : AbstractDictionary
    """

    noise: Noise
    forces: tuple[str, ...]
    lam: float
    threshold: float
    dictionary: AbstractDictionary

    @abc.abstractmethod
    def forced(self, model: Model, dt: float) -> Forced:
        """Discretise the model with its unknown forces as inputs, and check both.

        Raises
        ------
        TuningError
            If a force is unknown or cannot be seen, or the noise does not fit.
        """

    @abc.abstractmethod
    def linearised(self, model: Model, dt: float) -> Forced:
        """`forced` of a model that need not be linear, at the prior's mean.

        Its setting has the model itself, and the integrator that carries it over a sample.

        Raises
        ------
        TuningError
            As `forced`.
        """

    @abc.abstractmethod
    def sides(self) -> Array:
        """Sign of every atom: 1, -1, or 0 if it is free."""

    @abc.abstractmethod
    def weighted(self, lam: float) -> "AbstractForceEstimator":
        """The same with another weight, with every force shown and nothing carried on."""


def force_groups(groups: Sequence[Sequence[str]], forces: Sequence[str]) -> list[int]:
    """Number of the group of every force; those that are in none are alone.

    Raises
    ------
    TuningError
        If a name is none of the forces, or twice in groups.
    """
    names = [name for group in groups for name in group]
    for name in names:
        if name not in forces:
            raise TuningError(f"groups: '{name}' is none of the forces: {nearest(name, forces)}")
        if names.count(name) > 1:
            raise TuningError(f"groups: '{name}' is named twice; a force is in one group")
    first = {name: forces.index(group[0]) for group in groups for name in group}
    return [first.get(name, i) for i, name in enumerate(forces)]

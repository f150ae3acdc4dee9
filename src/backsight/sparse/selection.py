"""Ways to choose, out of all places and moments, those at which a force has acted."""

import abc
import dataclasses
import math
from typing import Annotated, Literal, final

import numpy as np
from numpy.typing import ArrayLike

from backsight.description import Count, Description, Positive, Range
from backsight.errors import DataError, TuningError
from backsight.estimators.force_estimator import force_groups
from backsight.sparse._best_groups import best_groups
from backsight.sparse._best_subset import best_subset
from backsight.sparse._force_search import ForceSearch
from backsight.sparse._l1_path import l1_path
from backsight.sparse.regression import Fit, Indices, inverted, refit
from backsight.types import Array

ROUNDING = 1e-6
"""Violation of an optimality condition, as a share of lam, that is no violation."""


SMALLEST = 1e-12
"""Weight at which a path ends that is to end by its number of kinks."""


@dataclasses.dataclass(frozen=True)
class AbstractSelection(Description, abc.ABC):
    """A way to choose atoms."""

    @abc.abstractmethod
    def select(self, search: ForceSearch) -> Fit:
        """Atoms, their factors and covariance, cost."""


@final
@dataclasses.dataclass(frozen=True)
class L1(AbstractSelection):
    r"""The l1 norm chooses: :math:`\min \|y - H\alpha\|^2 + \lambda |\alpha|_1`.

    Parameters
    ----------
    refit : bool
        Fit the chosen atoms once more without the l1 norm, which makes all of them too small.

    Examples
    --------
    >>> bs.forces.L1().refit
    True
    """

    refit: bool = True

    def select(self, search: ForceSearch) -> Fit:
        """See `AbstractSelection.select`."""
        which, values = _l1(search)
        return _ended(search, which, values, again=self.refit)

    def price(self, search: ForceSearch, fit: Fit) -> float:
        """What the atoms cost beside the squared residuals."""
        return search.lam * float(np.abs(fit.values).sum())


@final
@dataclasses.dataclass(frozen=True)
class Reweighted(AbstractSelection):
    r"""The l1 norm, repeated with smaller weights for what was found.

    In every pass the weights are :math:`\lambda f / (f + |\alpha_i|)` with the factors of the last
    one, so that large forces cost little more than being there at all.

    Parameters
    ----------
    iterations : int
        Passes after the first.
    floor : float
        f, as a share of the largest factor of the first pass.
    refit : bool
        As in `L1`.

    References
    ----------
    Candès, Wakin, Boyd, "Enhancing sparsity by reweighted l1 minimization", 2008, Journal of
    Fourier Analysis and Applications 14, doi:10.1007/s00041-008-9045-x.

    Examples
    --------
    >>> bs.forces.Reweighted(iterations=2).iterations
    2
    """

    iterations: Count = 3
    floor: Positive = 0.1
    refit: bool = True

    def select(self, search: ForceSearch) -> Fit:
        """See `AbstractSelection.select`."""
        which, values = _l1(search)
        floor = self.floor * np.abs(values).max(initial=0.0)
        for _ in range(self.iterations):
            if not len(which):
                break
            weights = np.ones(len(search.step))
            weights[which] = floor / (floor + np.abs(values))
            which, values = _l1(search, weights)
        return _ended(search, which, values, again=self.refit)


@final
@dataclasses.dataclass(frozen=True)
class Greedy(AbstractSelection):
    r"""Every atom costs the same, however large it is.

    The search lowers :math:`\|y - H\alpha\|^2 + \mu |\alpha|_0`, the l0 "norm" in place of l1.
    Atoms are added, exchanged and removed one by one as long as it falls, starting from none; and
    once more, from those that the l1 norm finds first. The better end is taken; lam is not used.

    Parameters
    ----------
    penalty : float, optional
        :math:`\mu`: what an atom must gain, in squared standard deviations. If not given
        :math:`2 \ln n` for n atoms, the largest gain that noise is expected to offer.

    References
    ----------
    Foster, George, "The risk inflation criterion for multiple regression", 1994, Annals of
    Statistics 22, doi:10.1214/aos/1176325766.

    Examples
    --------
    >>> bs.forces.Greedy(penalty=3.0).penalty
    3.0
    """

    penalty: Positive | None = None

    def select(self, search: ForceSearch) -> Fit:
        """See `AbstractSelection.select`."""
        penalty = self._penalty(search)
        grown = best_subset(search.regression, penalty)
        path = l1_path(search.regression, SMALLEST, most=2 * len(grown.which) + 1)
        first = path.which[path.values[-1] != 0]
        pruned = best_subset(search.regression, penalty, start=first)
        best = min(grown, pruned, key=lambda end: end.cost + penalty * len(end.which))
        return _ended(search, best.which, best.values, again=True)

    def price(self, search: ForceSearch, fit: Fit) -> float:
        """What the atoms cost beside the squared residuals."""
        return self._penalty(search) * len(fit.which)

    def _penalty(self, search: ForceSearch) -> float:
        return 2 * math.log(len(search.step)) if self.penalty is None else self.penalty


@final
@dataclasses.dataclass(frozen=True)
class GreedyGroups(AbstractSelection):
    r"""Groups of forces come together, and every force of a group costs the same.

    As `Greedy`, but groups are added, exchanged and removed as a whole, as long as
    :math:`\|y - H\alpha\|^2 + \mu \operatorname{rank} H` falls: forces along the axes of a node,
    or all steps at one place, which somebody pushes for long. lam is not used.

    Parameters
    ----------
    groups : tuple of tuples of str
        Forces that come together; the others are alone.
    span : {"step", "recording"}
        A group is about one step, or about all of them.
    penalty : float, optional
        :math:`\mu`, as of `Greedy`.

    References
    ----------
    Lozano, Swirszcz, Abe, "Grouped orthogonal matching pursuit for variable selection and
    prediction", 2009, Advances in Neural Information Processing Systems 22.

    Examples
    --------
    >>> bs.forces.GreedyGroups(groups=(("x", "y", "z"),)).span
    'step'
    """

    groups: tuple[tuple[str, ...], ...] = ()
    span: Literal["step", "recording"] = "step"
    penalty: Positive | None = None

    def select(self, search: ForceSearch) -> Fit:
        """See `AbstractSelection.select`."""
        if search.regression.side.any():
            raise TuningError("GreedyGroups knows no signs: leave out nonnegative and nonpositive")
        penalty = 2 * math.log(len(search.step)) if self.penalty is None else self.penalty
        best = best_groups(search.regression, self._labels(search), penalty)
        return _ended(search, best.which, best.values, again=True)

    def _labels(self, search: ForceSearch) -> Indices:
        """Number of the group of every column."""
        names = search.filter.forced.names
        groups = force_groups(self.groups, names)
        touched = np.abs(search.shapes).max(axis=1) > 0
        alone = touched.sum(axis=0) == 1
        atoms = touched.shape[1]
        own = len(names) + np.arange(atoms)  # of atoms that move several forces
        of_atom = np.where(alone, np.array(groups)[touched.argmax(axis=0)], own)
        step = search.step if self.span == "step" else np.zeros_like(search.step)
        return step * (len(names) + atoms) + of_atom[search.atom]


@final
@dataclasses.dataclass(frozen=True)
class Given(AbstractSelection):
    """The places and moments are known, or somebody else's: only how large the forces were is not.

    Parameters
    ----------
    forces : (time, force) array
        Not zero where a force has acted, such as the ``d_hat`` of an estimator.

    Examples
    --------
    >>> import numpy as np
    >>> bs.forces.Given(np.zeros((8, 1))).forces.shape
    (8, 1)
    """

    forces: Annotated[ArrayLike, Range("be finite", missing=True)]

    def select(self, search: ForceSearch) -> Fit:
        """See `AbstractSelection.select`."""
        given = np.nan_to_num(np.asarray(self.forces, float))
        nf, width, atoms = search.shapes.shape
        if given.shape != (search.samples, nf):
            raise DataError(
                f"the given forces have the shape {given.shape}; the recording and the estimator "
                f"have {(search.samples, nf)}"
            )
        if width != 1 or atoms != nf:
            raise TuningError("forces that are given by step need the dictionary Impulses()")
        active = np.abs(given[search.step, search.atom])
        return refit(search.regression, np.flatnonzero((active > 0) & (active >= search.threshold)))


def _l1(search: ForceSearch, weights: Array | None = None) -> tuple[Indices, Array]:
    path = l1_path(search.regression, search.lam, weights=weights)
    if not path.complete or path.kkt > ROUNDING:
        raise TuningError(
            f"the l1 problem could not be solved exactly down to lam = {search.lam:g}: "
            f"{len(path.lam)} times a force has come or gone by lam = {path.lam[-1]:.3g}; raise lam"
        )
    return path.at(search.lam)


def _ended(search: ForceSearch, which: Indices, values: Array, *, again: bool) -> Fit:
    """Drop what is below the threshold, and fit the rest again or leave it as it is."""
    large = np.abs(values) >= search.threshold
    which, values = which[large], values[large]
    if again:
        return refit(search.regression, which)
    columns = search.regression.columns[:, which]
    residual = search.regression.target - columns @ values
    return Fit(which, values, inverted(columns.T @ columns), float(residual @ residual))

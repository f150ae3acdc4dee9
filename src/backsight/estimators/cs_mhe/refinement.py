"""What a window may do once the l1 norm has chosen: shrink its weights, or count atoms."""

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Literal, final

import numpy as np

from backsight.description import Count, Description, Positive
from backsight.errors import TuningError, nearest
from backsight.estimators.force_estimator import AbstractDictionary
from backsight.estimators.parts.limits import Limit, Limits
from backsight.types import Array, ByName

Span = Literal["step", "window"]


@final
@dataclasses.dataclass(frozen=True)
class Reweighting(Description):
    r"""The l1 norm of a window, repeated with smaller weights for what was found.

    In every pass the weights are :math:`\lambda f / (f + \|\alpha_g\|)` with the factors of the
    last one, over the group g of an atom: large forces cost little more than being there at all,
    and where one of a group is, the others may be.

    Parameters
    ----------
    passes : int
        After the first.
    floor : float
        f, as a share of the largest group of the first pass.
    groups : tuple of tuples of str
        Forces that come together, such as those along the axes of one node; the others are alone.
    span : {"step", "window"}
        A group is about one step, or about all steps of a window: one place that is hit again and
        again, or pushed.

    References
    ----------
    Candès, Wakin, Boyd, "Enhancing sparsity by reweighted l1 minimization", 2008, Journal of
    Fourier Analysis and Applications 14, doi:10.1007/s00041-008-9045-x.

    Examples
    --------
    >>> bs.forces.Reweighting(groups=(("x", "y"),)).passes
    3
    """

    passes: Count = 3
    floor: Positive = 0.1
    groups: tuple[tuple[str, ...], ...] = ()
    span: Span = "step"


@final
@dataclasses.dataclass(frozen=True)
class Exchanges(Description):
    r"""Every atom of a window costs the same, however large it is: the l0 "norm" in place of l1.

    From the atoms that the l1 norm finds, and once more from none, atoms are added, exchanged and
    taken out one by one as long as :math:`\|r\|^2 + \mu |\alpha|_0` falls, r all that is least
    squares. The better end is taken: no single change betters it. As `Greedy` does it for whole
    recordings.

    Parameters
    ----------
    penalty : float, optional
        :math:`\mu`, in squared standard deviations. If not given :math:`2 \ln n` for n atoms in a
        window, the largest gain that noise is expected to offer.
    most : int
        Atoms that a window may have.

    References
    ----------
    Foster, George, "The risk inflation criterion for multiple regression", 1994, Annals of
    Statistics 22, doi:10.1214/aos/1176325766.

    Examples
    --------
    >>> bs.forces.Exchanges(penalty=12.0).most
    10
    """

    penalty: Positive | None = None
    most: Count = 10

    def price(self, atoms: int) -> float:
        """The penalty in a window of so many atoms."""
        return 2 * math.log(atoms) if self.penalty is None else self.penalty


Refinement = Reweighting | Exchanges


def sizes_of(refinement: Refinement | None) -> tuple[int, int]:
    """Passes with other weights, and most atoms of a window, as the kernel counts them."""
    match refinement:
        case Reweighting(passes=passes):
            return passes, 0
        case Exchanges(most=most):
            return 0, most
        case None:
            return 0, 0


def kernel_numbers(refinement: Refinement | None, atoms: int) -> list[float]:
    """Floor of the weights, and what an atom costs, for the kernel."""
    match refinement:
        case Reweighting(floor=floor):
            return [floor, 0.0]
        case Exchanges() as exchanges:
            return [0.0, exchanges.price(atoms)]
        case None:
            return [0.0, 0.0]


def faults_of(
    refinement: Refinement | None, limits: Sequence[Limit], largest: ByName, carryover: object
) -> Iterator[str]:
    """Say what a refinement does not go with."""
    sizes = [*largest.values()] if isinstance(largest, Mapping) else [largest]
    bounded = bool(limits) or np.isfinite(np.concatenate([np.ravel(k) for k in sizes])).any()
    if refinement is not None and (bounded or carryover is not None):
        yield (
            "refinement: a window with limits, largest forces or a carryover has none; leave one "
            "of them out"
        )


def groups_of(
    refinement: Refinement | None,
    forces: Sequence[str],
    dictionary: AbstractDictionary,
    steps: int,
    limits: Limits,
) -> Array:
    """Number of the group of every atom of a window, step by step, (steps atoms,).

    Parameters
    ----------
    refinement : Reweighting or Exchanges, optional
    forces : sequence of str
    dictionary : AbstractDictionary
    steps : int
    limits : Limits
        Of the window, with those of the states.

    Raises
    ------
    TuningError
        If there are limits, a name is none of the forces or in two groups, or atoms of groups move
        several forces.
    """
    if refinement is not None and limits.names:
        raise TuningError(
            f"refinement: a window with limits has none, and {', '.join(limits.names)} has some; "
            "leave one of them out"
        )
    belongs = dictionary.force_of(len(forces))
    atoms = len(belongs)
    first, span = np.arange(atoms), "step"
    if isinstance(refinement, Reweighting):
        span = refinement.span
        groups = _named(refinement.groups, forces)
        if span == "window":
            groups += [{i} for i in range(len(forces)) if not any(i in g for g in groups)]
        if groups and min(belongs) < 0:
            raise TuningError("groups of forces need a dictionary whose atoms are of one force")
        for group in groups:
            members = [a for a, force in enumerate(belongs) if force in group]
            first[members] = members[0]
    later = atoms if span == "step" else 0
    return np.concatenate([first + later * j for j in range(steps)]).astype(float)


def _named(groups: Sequence[Sequence[str]], forces: Sequence[str]) -> list[set[int]]:
    names = [name for group in groups for name in group]
    for name in names:
        if name not in forces:
            raise TuningError(f"groups: '{name}' is none of the forces: {nearest(name, forces)}")
        if names.count(name) > 1:
            raise TuningError(f"groups: '{name}' is named twice; a force is in one group")
    return [{forces.index(name) for name in group} for group in groups if group]

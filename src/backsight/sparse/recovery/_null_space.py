r"""Whether the smallest l1 norm belongs to the true forces, by linear programs.

Readings of a window :math:`y = O x_0 + \Gamma \alpha` are explained as well by every
:math:`(x_0 + z, \alpha + h)` with :math:`O z + \Gamma h = 0`. Of forces on the atoms S with signs
:math:`\sigma` the l1 norm is smaller than that of any other explanation exactly if

.. math:: -\sigma' h_S < \lVert h_{S^c} \rVert_1 \quad \text{for all such } h \neq 0,

whatever their sizes are (the null space property, here of the part of Γ that no first state can
imitate). The largest left side for a right side of one, its `ratio`, is a linear program, solved in
its dual form: find p with :math:`\Phi_S' p = \sigma` and the smallest bound t of
:math:`|\Phi_j' p|` elsewhere. A p with t < 1 is the proof, for every force on S with these signs.

Sources: Poe, Mallada, Vidal, "Necessary and sufficient conditions for simultaneous state and input
recovery of linear systems with sparse inputs by l1-minimization", 2023, arXiv:2304.05526.
Fuchs, "On sparse representations in arbitrary redundant bases", 2004, IEEE Transactions on
Information Theory 50, doi:10.1109/TIT.2004.828141.
"""

import dataclasses
import itertools
import math

import numpy as np
import scipy

from backsight.types import Array

NEGLIGIBLE = 1e-10
"""Singular values below this share of the largest are zero."""


@dataclasses.dataclass(frozen=True)
class Seen:
    """What the readings of a window show, in standard deviations of their noise.

    Parameters
    ----------
    start : (readings, states) array
        O, of the first state.
    atoms : (readings, atoms) array
        Gamma, of the factors of the atoms.
    sides : (atoms,) array
        Known sign of the factors; 0 if free.
    """

    start: Array
    atoms: Array
    sides: Array

    def state_is_seen(self) -> bool:
        """Whether two first states never look the same."""
        scale = np.linalg.norm(self.start, axis=0)
        if not (scale > 0).all():
            return False
        values = np.linalg.svd(self.start / scale, compute_uv=False)
        return len(values) == len(scale) and values[-1] > NEGLIGIBLE * values[0]

    def without_state(self) -> Array:
        """Phi (readings - states, atoms): what no first state can imitate."""
        left, _ = np.linalg.qr(self.start, mode="complete")
        return left[:, self.start.shape[1] :].T @ self.atoms


@dataclasses.dataclass(frozen=True)
class Ratios:
    """The linear programs of one set of atoms.

    Parameters
    ----------
    rows : (rank, atoms) array
        Orthonormal rows with the null space of Phi.
    sides : (atoms,) array
    """

    rows: Array
    sides: Array

    def worst(self, support: tuple[int, ...]) -> float:
        """Largest ratio over all signs of factors on the support; infinite if they look alike."""
        return max(self.ratio(support, signs) for signs in self._signs(support))

    def ratio(self, support: tuple[int, ...], signs: Array) -> float:
        """Least t, see above; below one exactly if these signs on this support are recovered."""
        rank, n = self.rows.shape
        rest = np.setdiff1d(np.arange(n), support)
        elsewhere, side = self.rows[:, rest].T, self.sides[rest]
        bound = -np.ones((len(rest), 1))
        above, below = np.hstack([elsewhere, bound]), np.hstack([-elsewhere, bound])
        # A factor that cannot be negative cannot make the norm smaller from below, and vice versa.
        limits = np.vstack([above[side >= 0], below[side <= 0]])
        there = self.rows[:, list(support)].T
        found = scipy.optimize.linprog(
            np.append(np.zeros(rank), 1.0),
            A_ub=limits,
            b_ub=np.zeros(len(limits)),
            A_eq=np.hstack([there, np.zeros((len(support), 1))]),
            b_eq=signs,
            bounds=[(None, None)] * rank + [(0.0, None)],
            method="highs",
        )
        return float(found.fun) if found.status == 0 else math.inf

    def _signs(self, support: tuple[int, ...]) -> list[Array]:
        """Signs to try: with all turned over the program is the same if all factors are free."""
        choices = [(1.0, -1.0) if side == 0 else (side,) for side in self.sides[list(support)]]
        if not self.sides.any():
            choices[0] = (1.0,)
        return [np.array(signs) for signs in itertools.product(*choices)]


def ratios(phi: Array, sides: Array) -> Ratios:
    """Programs of atoms with columns phi, rows made orthonormal."""
    _, values, rows = np.linalg.svd(phi, full_matrices=False)
    rank = int((values > NEGLIGIBLE * values[0]).sum())
    return Ratios(rows[:rank], sides)


def worst_error(seen: Seen, atom: int, noise: float) -> float:
    r"""Largest error of one factor where no reading is off by more than `noise` deviations.

    Of the explanations that keep to this limit the one with the smallest l1 norm is taken. So
    :math:`|O z + \Gamma h| \le 2 \cdot` `noise`, and
    :math:`\lVert h_{S^c} \rVert_1 \le -\sigma h_S`: all other factors together are off by no more
    than this one. With the other sign, where both are possible and no other side is known, the
    program is the same turned over.
    """
    known = seen.sides[atom]
    if known or not seen.sides.any():
        return _error_with_sign(seen, atom, known or 1.0, noise)
    return max(_error_with_sign(seen, atom, sign, noise) for sign in (1.0, -1.0))


def _error_with_sign(seen: Seen, atom: int, sign: float, noise: float) -> float:
    m, nx = seen.start.shape
    n = seen.atoms.shape[1]
    rest = np.delete(np.arange(n), atom)
    side = seen.sides[rest]
    # Variables: z scaled, h of the atom, h elsewhere upwards and downwards (each at least 0).
    z = seen.start / np.linalg.norm(seen.start, axis=0)
    up, down = rest[side >= 0], rest[side <= 0]
    readings = np.hstack([z, seen.atoms[:, [atom]], seen.atoms[:, up], -seen.atoms[:, down]])
    others = len(up) + len(down)
    cone = np.concatenate([np.zeros(nx), [sign], np.ones(others)])
    goal = np.zeros(nx + 1 + others)
    goal[nx] = sign
    found = scipy.optimize.linprog(
        goal,
        A_ub=scipy.sparse.csr_array(np.vstack([readings, -readings, cone])),
        b_ub=np.append(np.full(2 * m, 2 * noise), 0.0),
        bounds=[(None, None)] * (nx + 1) + [(0.0, None)] * others,
        method="highs",
    )
    return float(-found.fun) if found.status == 0 else math.inf

"""Whether sensors can tell unknown forces apart, and the matrices by which they do."""

import dataclasses

import casadi as ca
import numpy as np

from backsight.analysis.observability import rank_of, transmission_zeros
from backsight.errors import TuningError
from backsight.estimators.parts.linear import Linear
from backsight.types import Array

GROWTH = 1e-6
"""A zero so far outside the unit circle is outside."""

WITH_DYNAMICS = (
    "let the force walk or follow a process: make it a state with 'augment' ([estimate] or "
    "[forces] in a problem file) and take a Kalman filter, which also finds forces that show later"
)
"""What is left where a force of which nothing is known cannot be found."""

LOST = 1e-6
"""Below this share of what all rows tell of the forces, the measured ones do not tell them."""


@dataclasses.dataclass(frozen=True)
class Forces:
    """Unknown forces in a linear system, in units in which every column of `H` has length one.

    Parameters
    ----------
    system : Linear
        The forces are its last inputs.
    names : tuple of str
    E, F, H : (nx, m), (ny, m), (ny, m) arrays
        Of the forces to the next state, to the output of the sample, and to the output by which
        they are found.
    unit : (m,) array
        Physical force per unit used here.
    spread : (m, m) array
        Covariance of forces that were not seen; zero until it is known.
    """

    system: Linear
    names: tuple[str, ...]
    E: Array
    F: Array
    H: Array
    unit: Array
    spread: Array

    @property
    def direct(self) -> bool:
        """Whether the outputs contain the forces of their own sample."""
        return bool(self.F.any())

    @property
    def nu(self) -> int:
        """Number of known inputs."""
        return self.system.s.model.nu - len(self.names)

    def cross(self) -> ca.Function:
        """Covariance of scaled states and forces (nx, m) to that of physical ones, as a column."""
        size = np.outer(self.system.s.sx, self.unit)
        P = ca.SX.sym("P_xd", *size.shape)
        return ca.Function("physical_cross", [P], [ca.vec(P * ca.SX(size))])


def forces_of(system: Linear, names: tuple[str, ...]) -> Forces:
    """Matrices of the last inputs, which are unknown forces; they are held between samples.

    Raises
    ------
    TuningError
        If the sensors do not tell all forces apart at one sample, or the error would grow.
    """
    m = len(names)
    E, F = (system.B + system.B_next)[:, -m:], system.D[:, -m:]
    H = F if F.any() else system.C @ E
    _check_rank(E, F, H, names)
    length = np.linalg.norm(H, axis=0)
    zeros = transmission_zeros(system.A, E, system.C, F)
    growing = zeros[np.abs(zeros) > 1 + GROWTH] if len(zeros) else zeros
    if len(growing):
        worst = growing[np.argmax(np.abs(growing))]
        shown = f"{worst.real:.4g}" if abs(worst.imag) < 1e-9 else f"{worst:.4g}"
        raise TuningError(
            f"forces {', '.join(names)}: an error of the estimate would grow by the transmission "
            f"zero {shown} from sample to sample; add a sensor, put the sensors where the forces "
            f"act, or sample less often; or {WITH_DYNAMICS}"
        )
    return Forces(
        system=system,
        names=names,
        E=E / length,
        F=F / length,
        H=H / length,
        unit=system.s.su[-m:] / length,
        spread=np.zeros((m, m)),
    )


def comparable(found: Forces) -> tuple[Array, Array]:
    """Weights by which rows of outputs can be compared, and `Forces.H` with them.

    Its columns have the length one.

    A sensor with noise is scaled by it, one without by nothing: each by what the prior lets expect.
    """
    s, C = found.system.s, found.system.C
    expected = np.sqrt(np.diag(s.R + C @ s.P0 @ C.T))
    rows = 1 / np.where(expected > 0, expected, 1.0)
    columns = 1 / np.linalg.norm(rows[:, None] * found.H, axis=0)
    weights = np.asarray(np.outer(rows, columns), float)
    return weights, weights * found.H


def _check_rank(E: Array, F: Array, H: Array, names: tuple[str, ...]) -> None:
    ny, m = H.shape
    listed = f"{m} forces ({', '.join(names)})"
    what = "rank(D)" if F.any() else "rank(C B)"
    blind = [n for n, column in zip(names, H.T, strict=True) if not column.any()]
    if m > ny:
        raise TuningError(
            f"{listed} cannot be found with {ny} sensor{'s' if ny > 1 else ''}: {what} is at most "
            f"{ny}; add sensors, name fewer forces, or take a method for sparse forces"
        )
    if blind and F.any():
        raise TuningError(
            f"the sensors contain some forces directly, but not {', '.join(blind)}: {what} is "
            f"{rank_of(H)} of {m}; use sensors of one kind (only accelerations, or none), or "
            "name fewer forces"
        )
    if blind:
        raise TuningError(
            f"no sensor shows {', '.join(blind)} one sample later: {what} is {rank_of(H)} of "
            f"{m}; add a sensor near it, an accelerometer where it acts, or {WITH_DYNAMICS}"
        )
    rank, ways = rank_of(H), rank_of(E)
    if rank < m:
        limit = f"; they move the states in {ways} independent ways only" if ways < m else ""
        raise TuningError(
            f"{listed} cannot be told apart by these sensors: {what} is {rank} of {m}{limit}; name "
            f"at most {rank} of them, move or add sensors, or take more modes"
        )

"""How many unknown forces a random walk can follow at once, and what limits it.

Source: Kirchner, Croes, Cosco, Desmet, "Exploiting input sparsity for joint state/input moving
horizon estimation", section 4.2: the rank of the observability matrix against the number of states.
"""

from collections.abc import Sequence

import numpy as np
import scipy
import xarray as xr
from numpy.typing import NDArray

from backsight.analysis.observability.zeros import rank_of, transmission_zeros
from backsight.description import Positive, checked
from backsight.discrete.exact import zoh
from backsight.errors import ModelError
from backsight.models.forces.unknown_forces import forces_as_inputs
from backsight.models.lti import state_space
from backsight.models.model import Model
from backsight.types import Array

TOLERANCE = 1e-9
"""Singular values below this share of the largest are zero, states and outputs made comparable."""


@checked(ModelError)
def check_force_locations(
    model: Model, dt: Positive, *, forces: Sequence[str] | None = None
) -> xr.Dataset:
    r"""Judge a model to which more and more random-walk forces are added as states.

    With :math:`d_{k+1} = d_k` the joint model is

    .. math::
        \begin{bmatrix} x \\ d \end{bmatrix}_{k+1} =
        \begin{bmatrix} A & E \\ 0 & I \end{bmatrix} \begin{bmatrix} x \\ d \end{bmatrix}_k,
        \qquad y_k = \begin{bmatrix} C & F \end{bmatrix} \begin{bmatrix} x \\ d \end{bmatrix}_k .

    If (A, C) is observable it is observable exactly if the matrix of Popov, Belevitch and Hautus
    at the eigenvalue 1 of the walks,

    .. math:: \begin{bmatrix} A - I & E \\ C & F \end{bmatrix},

    has full column rank: constant forces must show in the outputs, each in its own way.

    Parameters
    ----------
    model : Model
        Linear; the forces are parameters of it.
    dt : float
        Sampling period [s].
    forces : sequence of str, optional
        Names in the order in which they are added; all parameters if not given.

    Returns
    -------
    xarray.Dataset
        Over ``order`` ("forward", "backward") and ``number`` of forces, from 0 on: ``rank`` of the
        observability matrix, ``pbh`` of the matrix above, ``observable``, ``weakest`` and ``next``
        (the last singular value that counts and the first that does not, as shares of the largest);
        ``states (number)``. Its attributes: ``rank_forces``, the ways in which the forces move the
        states in one sample; ``rank_static``, the ways in which constant forces show;
        ``most``, the largest number that is observable in both orders; ``verdict`` in words.

    Raises
    ------
    ModelError
        If the model is not linear or a name is unknown.

    Examples
    --------
    >>> beam = bs.models.beam(
    ...     length=1.0,
    ...     width=0.02,
    ...     thickness=5e-3,
    ...     youngs_modulus=7e10,
    ...     density=2700.0,
    ...     modes=2,
    ...     sensors={"tip": ("displacement", 1.0), "mid": ("displacement", 0.5)},
    ...     forces={"hit": 0.7},
    ... )
    >>> list(bs.check.check_force_locations(beam, 1e-3).data_vars)
    ['rank', 'pbh', 'weakest', 'next', 'states', 'observable']
    """
    names = [s.name for s in model.parameters] if forces is None else list(forces)
    A, E, C, F = _sampled(model, names, dt)
    numbers, places = range(len(names) + 1), list(range(len(names)))
    rows = {
        order: [_judged(A, E[:, kept[:n]], C, F[:, kept[:n]]) for n in numbers]
        for order, kept in (("forward", places), ("backward", places[::-1]))
    }
    result = xr.Dataset(
        {
            name: (("order", "number"), np.array([[row[i] for row in rows[o]] for o in rows]))
            for i, name in enumerate(("rank", "pbh", "weakest", "next"))
        },
        coords={"order": list(rows), "number": list(numbers)},
    )
    result["states"] = ("number", len(A) + np.arange(len(numbers)))
    result["observable"] = result["rank"] == result["states"]
    last = result["pbh"].isel(order=0)
    result.attrs = {
        "model": model.name,
        "forces": names,
        "rank_forces": rank_of(np.vstack([E, F])),
        "rank_static": int(last[-1] - last[0]),
        "most": int(result["observable"].all("order").sum()) - 1,
    }
    result.attrs["verdict"] = _verdict(result, model, _blind(A, E, C, F))
    return result


def force_zeros(
    model: Model, dt: float, *, forces: Sequence[str] | None = None
) -> NDArray[np.complex128]:
    """Transmission zeros from the independent ways in which forces move the states to the outputs.

    However many places there are, forces at them act through `rank_forces` numbers per sample only
    (of a beam: the modal forces). An error in these numbers evolves by the zeros.

    Parameters
    ----------
    model, dt, forces
        As in `check_force_locations`.

    Raises
    ------
    ModelError
        See `transmission_zeros`: the sensors do not tell all ways apart.
    """
    names = [s.name for s in model.parameters] if forces is None else list(forces)
    A, E, C, F = _sampled(model, names, dt)
    both = np.vstack([E, F])
    ways = np.linalg.svd(both)[2][: rank_of(both)].T
    return transmission_zeros(A, E @ ways, C, F @ ways)


def _sampled(model: Model, names: list[str], dt: float) -> tuple[Array, Array, Array, Array]:
    """A, E, C, F from sample to sample, states balanced, rows of the outputs of length one."""
    joined = forces_as_inputs(model, names)
    A, B, C, D = state_space(joined)
    if model.continuous:
        A, B = zoh(A, B, dt=dt)
    elif not np.isclose(model.dt or 0.0, dt, rtol=1e-2):
        raise ModelError(f"the model has dt = {model.dt:g} s, not {dt:g} s")
    _, (size, _) = scipy.linalg.matrix_balance(A, permute=False, separate=True)
    A, E, C = A * size / size[:, None], B[:, model.nu :] / size[:, None], C * size
    F = D[:, model.nu :]
    of_y, of_d = _lengths(np.hstack([C, F]), 1), _lengths(np.vstack([E, F]), 0)
    return A, E / of_d, C / of_y[:, None], F / of_d / of_y[:, None]


def _judged(A: Array, E: Array, C: Array, F: Array) -> tuple[int, int, float, float]:
    """Rank, rank of the test at one, weakest singular value that counts, and the next."""
    n, m = E.shape
    joint = np.block([[A, E], [np.zeros((m, n)), np.eye(m)]])
    blocks = [np.hstack([C, F])]
    # However many walks there are, one power more than for x alone spans all of them.
    for _ in range(n):
        blocks.append(blocks[-1] @ joint)
    values = _singular_values(np.vstack(blocks))
    rank = int((values > TOLERANCE).sum())
    at_one = _singular_values(np.block([[A - np.eye(n), E], [C, F]]))
    beyond = float(values[rank]) if rank < len(values) else 0.0
    return rank, int((at_one > TOLERANCE).sum()), float(values[max(rank - 1, 0)]), beyond


def _singular_values(matrix: Array) -> Array:
    """In units of the largest, columns of length one."""
    values = np.linalg.svd(matrix / _lengths(matrix, 0), compute_uv=False)
    return values / max(values[0], np.finfo(float).tiny)


def _lengths(matrix: Array, axis: int) -> Array:
    lengths = np.linalg.norm(matrix, axis=axis)
    return np.where(lengths > 0, lengths, 1.0)


def _blind(A: Array, E: Array, C: Array, F: Array) -> list[int]:
    """Outputs that show no constant force; none is named if constant forces go on moving."""
    still = np.eye(len(A)) - A
    if np.linalg.cond(still) > 1 / TOLERANCE:
        return []
    gain = C @ np.linalg.solve(still, E) + F
    return [int(i) for i in np.flatnonzero(np.abs(gain).max(axis=1, initial=0.0) < TOLERANCE)]


def _verdict(result: xr.Dataset, model: Model, blind: list[int]) -> str:
    about, total = result.attrs, result.sizes["number"] - 1
    if about["most"] < 0:
        return (
            f"{model.name}: the states are not observable even without forces; "
            "see `check_observability`"
        )
    most = f"random-walk forces at up to {about['most']} of {total} places are observable"
    states = int(result["states"][0]) + about["most"]
    if about["most"] == total:
        return f"{model.name}: {most} ({states} states): all of them"
    reasons = []
    seeing = model.ny - len(blind)
    if about["rank_static"] >= seeing > 0:
        sensors = f"{seeing} sensors" if seeing > 1 else "one sensor"
        reasons.append(f"constant forces show in {sensors}, one number in each")
    if about["rank_forces"] <= max(about["rank_static"], about["most"]):
        reasons.append(f"the forces move the states in {about['rank_forces']} ways (modes) only")
    if blind:
        named = ", ".join(model.outputs[i].name for i in blind)
        reasons.append(
            f"constant forces do not show in {named}, but in displacements; what is known of these "
            "can be told by dummy measurements (with_dummies)"
        )
    if not reasons:
        reasons.append(f"constant forces show in {about['rank_static']} independent ways only")
    return f"{model.name}: {most} ({states} states), in either order: {'; '.join(reasons)}"

"""A load that travels along a structure, at a place that is known at every time."""

import dataclasses
from collections.abc import Mapping, Sequence

import casadi as ca
import numpy as np
import scipy

from backsight.description import checked
from backsight.errors import ModelError, nearest
from backsight.models.model import Model
from backsight.models.signals import Signal
from backsight.types import Array

_CLOSEST, _FARTHEST = 1e-9, 1e90
"""Distance of two places at least, by the length of the path, and how long that is at most."""


@checked(ModelError)
def moving_load(
    model: Model,
    name: str,
    *,
    position: str,
    along: Mapping[str, float],
    supports: Sequence[float] = (),
    unit: str = "m",
) -> Model:
    r"""Join forces at places of a structure to one load that moves along them.

    .. math:: F_i = N_i(s)\,P, \qquad \sum_i \varphi(x_i)\, F_i \approx \varphi(s)\, P

    with the cardinal functions :math:`N_i` of the cubic spline through the places: every mode shape
    is interpolated, in states and sensors alike. The model stays linear in its states.

    Parameters
    ----------
    model : Model
        With a parameter of the value 0 for a force at every place, as `beam`, `modal`, `reduced`
        and `second_order` make them.
    name : str
        Of the load P. It becomes a parameter with the value 0, or keeps its own if the model has
        it; `augment` makes a state of it, also one with dynamics.
    position : str
        Name of the input that says where the load is, s; new, or one of the model. Off the ends
        there is no load. Take ``hold = "foh"``: the load travels between the samples.
    along : dict
        Force to its place on the way.
    supports : sequence of float
        Places on the way where no force moves anything, such as the ends of a bridge.
    unit : str
        Of the position.

    Returns
    -------
    Model
        With `name` in place of the forces `along`, and the input `position`.

    Raises
    ------
    ModelError
        If a force is unknown, there are fewer than four places, or two are the same.

    Notes
    -----
    The error of a spline falls with the fourth power of the distance of its places: ten on the
    shortest wave of a mode lose less than a thousandth.

    Examples
    --------
    >>> import backsight as bs
    >>> places = {f"F{i}": 2.0 * i for i in range(1, 10)}
    >>> bridge = bs.beam(
    ...     20.0, bending_stiffness=2e9, mass_per_length=5e3, boundary="pinned-pinned", modes=2,
    ...     sensors={"mid": ("displacement", 10.0)}, forces=places,
    ... )
    >>> crossed = bs.forces.moving_load(
    ...     bridge, "P", position="s", along=places, supports=(0.0, 20.0)
    ... )
    >>> print(crossed)
    beam (continuous)
    ├── states      q1, q2, q1_dot, q2_dot
    ├── inputs      s [m]
    ├── outputs     mid [m]
    └── parameters  P = 0
    """
    known = {s.name: s for s in model.parameters}
    for force in along:
        if force not in known:
            raise ModelError(f"the model has no parameter '{force}': {nearest(force, known)}")
    places = np.array([*along.values(), *supports], float)
    order = np.argsort(places)
    if len(places) < 4 or not np.isfinite(places).all() or (np.diff(places[order]) <= 0).any():
        raise ModelError(
            f"the load '{name}' moves along {len(places)} places; give four or more, all different"
        )
    # The spline divides by the third power of the distances.
    gaps = np.diff(places[order])
    if gaps.min() < _CLOSEST * gaps.sum() or not 1 / _FARTHEST < gaps.sum() < _FARTHEST:
        raise ModelError(
            f"the load '{name}' moves along places that are from {gaps.min():.3g} to "
            f"{gaps.max():.3g} apart, which is no path; give all in the same unit"
        )
    kept = [s for s in model.parameters if s.name not in along and s.name != name]
    load = known.get(name, Signal(name=name, unit=known[next(iter(along))].unit))
    inputs = [s.name for s in model.inputs]
    new = () if position in inputs else (Signal(name=position, unit=unit),)
    x, p = ca.SX.sym("x", model.nx), ca.SX.sym("p", len(kept) + 1)
    u = ca.SX.sym("u", model.nu + len(new))
    at = u[inputs.index(position) if position in inputs else model.nu]
    values = np.eye(len(places))[:, : len(along)][order]
    shares = _spline(places[order], values, at)
    symbols = {s.name: p[i] for i, s in enumerate(kept)} | {name: p[len(kept)]}
    symbols |= {force: shares[i] * p[len(kept)] for i, force in enumerate(along)}
    full = ca.vertcat(*(symbols[s.name] for s in model.parameters))
    given = [x, u[: model.nu], full]
    return dataclasses.replace(
        model,
        f=ca.Function("f", [x, u, p], model.f.call(given)),
        h=ca.Function("h", [x, u, p], model.h.call(given)),
        inputs=(*model.inputs, *new),
        parameters=(*kept, load),
        unsolved=model.unsolved_at([x, u, p], given),
    )


def _spline(knots: Array, values: Array, s: ca.SX) -> ca.SX:
    """Cubic spline through values (knots, n) at s, zero off its ends."""
    pieces = scipy.interpolate.CubicSpline(knots, values)
    total = ca.SX.zeros(values.shape[1])
    for k in range(len(knots) - 1):
        t = s - knots[k]
        cubic = ca.SX.zeros(values.shape[1])
        for power in pieces.c[:, k, :]:
            cubic = cubic * t + ca.DM(power)
        last = k == len(knots) - 2
        here = ca.logic_and(s >= knots[k], s <= knots[k + 1] if last else s < knots[k + 1])
        total += ca.if_else(here, cubic, 0)
    return total

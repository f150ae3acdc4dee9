r"""Angles that start anew after a turn: innovations on the circle, for every method.

An encoder that reads from 0 to 360 degrees, or from :math:`-\pi` to :math:`\pi`, leaves open how
many turns there were. The estimate knows: of all readings that may be meant, :math:`y + n P` with
the period P, the one next to the prediction enters the step. Its innovation is the shortest way
round,

.. math:: e' = e - P \operatorname{round}(e / P),

and a window keeps the reading with its turns.
"""

import dataclasses

import casadi as ca
import numpy as np

from backsight.algebra.symmetric import unvech
from backsight.engine.recursion import Recursion
from backsight.errors import TuningError
from backsight.estimators.around.robust import innovation_alone
from backsight.models.model import Model
from backsight.schema import Status
from backsight.types import Array

SURE = 3.0
"""Half a turn must be so many deviations of the innovation, else the turn is guessed."""


def periods(model: Model) -> Array:
    """Period of every output, (ny,); infinite of one that does not start anew."""
    return np.array([np.inf if s.wrap is None else s.wrap for s in model.outputs])


def on_circle(plain: Recursion, model: Model) -> Recursion:
    """Let readings enter with as many turns as bring them next to their prediction.

    Raises
    ------
    TuningError
        If the method looks back and does not tell the newest innovation.
    """
    period = periods(model)
    if not np.isfinite(period).any():
        return plain
    if plain.lag and plain.innovation is None:
        raise TuningError(
            f"'{plain.name}' looks back and cannot take angles that start anew after a turn "
            "(wrap): unwrap them before, or take another method"
        )
    sizes = (len(plain.carry0), *plain.input_sizes)
    given = [ca.MX.sym(f"d{i}", size) for i, size in enumerate(sizes)]
    carry, u, y, mask = given
    e, S = (plain.innovation or innovation_alone(plain)).call(given, True, False)
    turned, guessed = _turned(period)(e, S, mask)
    after, *values = plain.step.call([carry, u, y - turned, mask], True, False)
    named = dict(zip([c.name for c in plain.channels], values, strict=True))
    named["status"] = named["status"] + int(Status.TURN_GUESSED) * guessed
    shortest = ca.Function("innovation_on_circle", given, [e - turned, S])
    return dataclasses.replace(
        plain,
        step=ca.Function(plain.name, given, ca.cse([after, *named.values()])),
        innovation=shortest,
    )


def _turned(period: Array) -> ca.Function:
    """``(e, S, mask) -> (turns, guessed)``: whole turns that are too much in readings."""
    ny = len(period)
    e, triangle, mask = (
        ca.SX.sym(n, k) for n, k in (("e", ny), ("S", ny * (ny + 1) // 2), ("m", ny))
    )
    variance, turned, guessed = ca.diag(unvech(triangle)), ca.SX.zeros(ny), ca.SX(0)
    for i in np.flatnonzero(np.isfinite(period)):
        k, P = int(i), float(period[i])
        seen = mask[k] > 0
        turned[k] = ca.if_else(seen, P * ca.floor(e[k] / P + 0.5), 0)
        unsure = SURE**2 * variance[k] > (P / 2) ** 2
        guessed = ca.fmax(guessed, ca.logic_and(seen, unsure))
    return ca.Function("turned", [e, triangle, mask], [turned, guessed])

r"""How strongly the motion excites the parameters, eq. 9, over a sliding window.

Source: Riva, Dagen, Ortmaier, "Adaptive high-gain observer for joint state and parameter
estimation: a comparison to extended and unscented Kalman filter".
"""

import dataclasses
from typing import Annotated

import casadi as ca
import numpy as np

from backsight.algebra.factor import solve_spd
from backsight.algebra.symmetric import unvech, vech
from backsight.description import Called, Description, Positive
from backsight.estimators.parts.leaf import Results, leaf
from backsight.models.canonical.affine import AffineForm
from backsight.types import Array

BLOCKS = 20
"""Parts of the window; it slides by one of them."""


@dataclasses.dataclass(frozen=True)
class Excitation(Description):
    r"""Persistency of excitation per parameter.

    With the sensitivity :math:`s = \lambda^{-n} \Upsilon_1 \, \partial\theta/\partial p` of the
    innovation to the parameters, :math:`W = \int_{t-T}^t s' s \, d\tau` is the matrix of eq. 9.
    The level of a parameter is :math:`|p_i| \sqrt{1 / (T (W^{-1})_{ii})}`: the root mean square by
    which it moves the innovation in a way that no other parameter does [output unit].

    Parameters
    ----------
    window : float
        T [s]; one period of the motion or more.
    """

    window: Annotated[Positive, Called("the window of the excitation", "s")] = 0.5

    def block(self, dt: float) -> int:
        """Samples per block."""
        return max(1, round(self.window / (BLOCKS * dt)))


def excitation_start(window: Excitation, dt: float, p: int) -> dict[str, Array]:
    """Memory before the first sample; the clock runs down to the next block."""
    size = p * (p + 1) // 2
    return {
        "blocks": np.zeros(size * BLOCKS),
        "current": np.zeros(size),
        "left": np.array([float(window.block(dt))]),
        "filled": np.zeros(1),
        "level": np.zeros(p),
        "excited": np.ones(1),
    }


def excitation(window: Excitation, form: AffineForm, *, dt: float, sigma: float) -> ca.Function:
    """Advance the window by one sample.

    ``(*memory, Upsilon, lam, theta) -> memory``; a parameter counts as excited if the window
    determines it to better than 100 % from measurements with deviation `sigma`.
    """
    p, n, length = form.p, form.n, window.block(dt)
    size = p * (p + 1) // 2

    def formula(
        blocks: ca.SX,
        current: ca.SX,
        left: ca.SX,
        filled: ca.SX,
        level: ca.SX,
        excited: ca.SX,
        Upsilon: ca.SX,
        lam: ca.SX,
        theta: ca.SX,
    ) -> Results:
        s = ca.reshape(Upsilon, n, p)[0, :] / lam**n
        grown = current + dt * vech(s.T @ s)
        due = left <= 1
        shifted = ca.vertcat(blocks[size:], grown)
        total = sum((shifted[k * size : (k + 1) * size] for k in range(BLOCKS)), ca.SX.zeros(size))
        level_new = _levels(form, total, theta, T=window.block(dt) * BLOCKS * dt, sigma=sigma)
        full = filled + 1 >= BLOCKS
        needed = sigma / np.sqrt(length * BLOCKS)
        enough = ca.if_else(full, ca.if_else(ca.mmin(level_new) >= needed, 1, 0), 1)
        return {
            "blocks": ca.if_else(due, shifted, blocks),
            "current": ca.if_else(due, 0, grown),
            "left": ca.if_else(due, length, left - 1),
            "filled": ca.if_else(due, filled + 1, filled),
            "level": ca.if_else(due, level_new, level),
            "excited": ca.if_else(due, enough, excited),
        }

    sizes = {
        "blocks": size * BLOCKS, "current": size, "left": 1, "filled": 1, "level": p,
        "excited": 1, "Upsilon": n * p, "lam": 1, "theta": p,
    }  # fmt: skip
    return leaf("excitation", sizes, formula)


def _levels(form: AffineForm, total: ca.SX, theta: ca.SX, *, T: float, sigma: float) -> ca.SX:
    p = form.p
    parameters = form.physical.call([theta])[0]
    dtheta = ca.inv(ca.jacobian(parameters, theta))
    scaled = dtheta @ ca.diag(parameters)
    W = scaled.T @ unvech(total) @ scaled
    # A millionth of the noise keeps the matrix regular where nothing moves.
    floor = ca.SX.eye(p) * (1e-6 * sigma) ** 2 * T
    inverse = solve_spd(W + floor, ca.SX.eye(p))
    return ca.sqrt(1 / (T * ca.diag(inverse)))

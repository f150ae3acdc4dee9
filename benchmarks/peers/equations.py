"""The models once more in plain Python, as users of other libraries write them."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from backsight.estimators.scaled import Setting
from backsight.types import Array
from benchmarks.problems import FRICTION


class Stage:
    """Scaled equations of the stage with states q, v, k, b, c, w, and Heun's method.

    Parameters
    ----------
    setting : Setting
        Scales and sampling period.
    substeps : int
    """

    def __init__(self, setting: Setting, substeps: int) -> None:
        q, v, k, b, c, w = setting.sx
        u = setting.su[0]
        self.h = setting.dt / substeps
        self.substeps = substeps
        self.speed, self.spring, self.damper = v / q, k * q / v, b
        self.drive, self.force = c * u / v, w / v
        self.output = q / setting.sy[0]

    def rates(self, q: Any, v: Any, x: Sequence[Any], u: Any) -> tuple[Any, Any]:
        """Rates of q and v; the other states are constant."""
        pull = -self.spring * x[2] * q - self.damper * x[3] * v
        return self.speed * v, pull + self.drive * x[4] * u + self.force * x[5]

    def ahead(self, x: Sequence[Any], u: Any) -> tuple[Any, Any]:
        """Displacement and speed one sample later."""
        q, v = x[0], x[1]
        for _ in range(self.substeps):
            dq, dv = self.rates(q, v, x, u)
            dq_end, dv_end = self.rates(q + self.h * dq, v + self.h * dv, x, u)
            q, v = q + self.h / 2 * (dq + dq_end), v + self.h / 2 * (dv + dv_end)
        return q, v

    def jacobian(self, x: Array, u: float) -> tuple[Array, Array]:
        """State one sample later and its Jacobian (6, 6), by the chain rule."""
        h, x, F = self.h, x.copy(), np.eye(6)
        for _ in range(self.substeps):
            dq, dv = self.rates(x[0], x[1], x, u)
            Z = self._slope(x[0], x[1], x, u)
            q_end, v_end = x[0] + h * dq, x[1] + h * dv
            dq_end, dv_end = self.rates(q_end, v_end, x, u)
            E = np.eye(6)
            E[:2] += h * Z
            E_end = self._slope(q_end, v_end, x, u) @ E
            Phi = np.eye(6)
            Phi[:2] += h / 2 * (Z + E_end)
            F = Phi @ F
            x[0] += h / 2 * (dq + dq_end)
            x[1] += h / 2 * (dv + dv_end)
        return x, F

    def _slope(self, q: float, v: float, x: Array, u: float) -> Array:
        """Rows of the Jacobian of the rates that are not zero, (2, 6)."""
        return np.array(
            [
                [0.0, self.speed, 0.0, 0.0, 0.0, 0.0],
                [
                    -self.spring * x[2],
                    -self.damper * x[3],
                    -self.spring * q,
                    -self.damper * v,
                    self.drive * u,
                    self.force,
                ],
            ]
        )


class Punch:
    """Scaled equations of the punch with states q, v, c, d, 1/m, in plain numbers.

    Parameters
    ----------
    setting : Setting
    substeps : int
    """

    def __init__(self, setting: Setting, substeps: int) -> None:
        self.q, self.v, self.c, self.d, self.w = map(float, setting.sx)
        self.u = float(setting.su[0])
        self.h = setting.dt / substeps
        self.substeps = substeps

    def ahead(self, x: Array, dt: float, u: float) -> Array:
        """State one sample later; `dt` is what filterpy hands on."""
        q, v, c, d, w = (float(value) for value in x)
        q, v, c, d, w, F = q * self.q, v * self.v, c * self.c, d * self.d, w * self.w, u * self.u
        h = dt / self.substeps
        for _ in range(self.substeps):
            a = (F - c * q - d * v - FRICTION * math.tanh(50.0 * v)) * w
            q_end, v_end = q + h * v, v + h * a
            a_end = (F - c * q_end - d * v_end - FRICTION * math.tanh(50.0 * v_end)) * w
            q, v = q + h / 2 * (v + v_end), v + h / 2 * (a + a_end)
        return np.array([q / self.q, v / self.v, x[2], x[3], x[4]])

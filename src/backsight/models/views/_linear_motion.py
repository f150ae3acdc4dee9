"""Exact motion of a linear model from moment to moment, and a low-pass along straight lines."""

import dataclasses
import math

import casadi as ca
import numpy as np
import scipy

from backsight.errors import ModelError
from backsight.models.model import Model
from backsight.types import Array


def low_passed(s: ca.SX, begin: ca.SX, end: ca.SX, turn: float) -> ca.SX:
    """A low-pass of the first order after a straight line that takes ``turn`` time constants."""
    left = math.exp(-turn)
    mean = -math.expm1(-turn) / turn
    return left * s + (mean - left) * begin + (1 - mean) * end


@dataclasses.dataclass(frozen=True)
class LinearMotion:
    """A linear motion x' = A x + b, y = C x + g, with b and g expressions of what is held.

    Parameters
    ----------
    A, B, C : arrays
        By states, by what is held (inputs, parameters, one), and what the outputs see of states.
    held, direct : SX
        What is held, and what it adds to the outputs.
    """

    A: Array
    B: Array
    C: ca.DM
    held: ca.SX
    direct: ca.SX

    @staticmethod
    def of(model: Model, u: ca.SX, p: ca.SX) -> "LinearMotion":
        if model.driven or model.virtual is not None:
            raise ModelError(
                "sensors with a sampling period: add forces with dynamics, unknown parameters and "
                "virtual sensors after the sensors, not before"
            )
        x, held = ca.SX.sym("x", model.nx), ca.vertcat(u, p, 1)
        z = ca.vertcat(x, u, p)
        f, h = (k.call([x, u, p])[0] for k in (model.f, model.h))
        slopes = ca.jacobian(ca.vertcat(f, h), z)
        if bent := [s.name() for s in ca.symvar(slopes)]:
            raise ModelError(
                f"sensors with a sampling period need a model that is linear in states, inputs and "
                f"parameters; a slope of '{model.name}' depends on {', '.join(bent[:3])}: leave dt "
                "out, or write parameters that are not forces as numbers"
            )
        J = np.array(ca.DM(ca.densify(slopes)))
        rest = ca.Function("rest", [z], [ca.vertcat(f, h)])(np.zeros(z.numel()))
        J = np.hstack([J, np.array(rest)])
        own, nx = J[: model.nx], model.nx
        direct = ca.mtimes(ca.sparsify(ca.DM(J[nx:, nx:])), held)
        return LinearMotion(own[:, :nx], own[:, nx:], ca.sparsify(ca.DM(J[nx:, :nx])), held, direct)

    def moved(self, x: ca.SX, time: float) -> ca.SX:
        """State after a time in which all that is held stays."""
        nx, whole = len(self.A), np.zeros((len(self.A) + self.B.shape[1],) * 2)
        whole[:nx, :nx], whole[:nx, nx:] = self.A * time, self.B * time
        step = scipy.linalg.expm(whole)[:nx]
        by_state, by_held = (ca.sparsify(ca.DM(k)) for k in (step[:, :nx], step[:, nx:]))
        return ca.mtimes(by_state, x) + ca.mtimes(by_held, self.held)

    def seen(self, x: ca.SX) -> list[ca.SX]:
        """Outputs of a state."""
        return ca.vertsplit(ca.densify(ca.mtimes(self.C, x) + self.direct))

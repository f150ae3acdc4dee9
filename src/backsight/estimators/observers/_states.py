"""From what an observer integrates to what the model has: parameters, bounds, covariance."""

import dataclasses

import casadi as ca
import numpy as np

from backsight.algebra.bounds import clip
from backsight.algebra.symmetric import unvech, vech
from backsight.models.affine import AffineForm
from backsight.models.model import Model
from backsight.schema import Status
from backsight.types import Array

LEAST = 1e-9
"""A divisor below this share of its start value has passed through zero."""


@dataclasses.dataclass(frozen=True)
class States:
    """The states of the model: a chain, parameters behind theta, and constants.

    Parameters
    ----------
    form : AffineForm
    theta0 : (p,) array
        Start of theta.
    lower, upper : (n + number of parameters + q,) arrays
        Bounds, in the order of the states.
    """

    form: AffineForm
    theta0: Array
    lower: Array
    upper: Array

    @property
    def parameters(self) -> slice:
        """Where the parameters are among the states."""
        return slice(self.form.n, self.form.n + len(self.form.parameters))

    def observed(self) -> ca.Function:
        """``(x, theta, P, last) -> (x, theta, parameters, P, status)``.

        P goes from the covariance of chain, theta and constants to that of the states. Where a
        divisor among theta has passed through zero the parameters keep their `last` values. States
        outside their bounds are set to them, and theta follows.
        """
        form, p = self.form, self.form.p
        n, q = form.n, len(self.lower) - form.n - p
        x, theta, last = ca.SX.sym("x", n), ca.SX.sym("theta", p), ca.SX.sym("last", p)
        size = n + p + q
        vP = ca.SX.sym("P", size * (size + 1) // 2)

        defined = self._defined(theta)
        safe = ca.if_else(defined, theta, ca.SX(self.theta0))
        J = ca.SX.eye(size)
        values = last
        if p:
            symbol = ca.SX.sym("theta", p)
            physical = form.physical.call([symbol])[0]
            found, slope = ca.substitute(
                [physical, ca.jacobian(physical, symbol)], [symbol], [safe]
            )
            J[n : n + p, n : n + p] = slope
            values = ca.if_else(defined, found, last)
        x_in = clip(x, self.lower[:n], self.upper[:n])
        values_in = clip(values, self.lower[self.parameters], self.upper[self.parameters])
        moved = ca.norm_1(values_in - values) if p else ca.SX(0)
        theta_in = self._theta_within(theta, values_in, moved, defined)
        clipped = ca.if_else(moved + ca.norm_1(x_in - x) > 0, 1, 0)
        status = int(Status.UNDEFINED) * (1 - defined) + int(Status.CLIPPED) * clipped
        return ca.Function(
            "observed",
            [x, theta, vP, last],
            [x_in, theta_in, values_in, vech(ca.densify(J @ unvech(vP) @ J.T)), status],
        )

    def _defined(self, theta: ca.SX) -> ca.SX:
        """1 if no divisor has passed through zero."""
        defined = ca.SX(1)
        for i in self.form.divisors:
            start = float(self.theta0[i])
            defined = ca.if_else(theta[i] * np.sign(start) > LEAST * abs(start), defined, 0)
        return defined

    def _theta_within(self, theta: ca.SX, values: ca.SX, moved: ca.SX, defined: ca.SX) -> ca.SX:
        """Theta of the bounded parameters, only where a bound is active."""
        bounded = np.isfinite([self.lower[self.parameters], self.upper[self.parameters]])
        if not bounded.any():
            return theta
        outside = ca.logic_or(moved > 0, defined < 1)
        return ca.if_else(outside, self.form.theta.call([values])[0], theta)


def bounds(model: Model) -> tuple[Array, Array]:
    """Lower and upper bounds of the states, (nx,) each."""
    return np.array([s.lower for s in model.states]), np.array([s.upper for s in model.states])

"""From what an observer integrates to what the model has: parameters, bounds, covariance."""

import dataclasses

import casadi as ca
import numpy as np

from backsight.algebra.bounds import clip
from backsight.estimators.parts.flags import Flags
from backsight.estimators.parts.leaf import Results, Symmetric, leaf
from backsight.models.affine import AffineForm
from backsight.models.model import Model
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
        """``(x, theta, P, last) -> (x, theta, parameters, P, flags)``.

        P goes from the covariance of chain, theta and constants to that of the states. Where a
        divisor among theta has passed through zero the parameters keep their `last` values. States
        outside their bounds are set to them, and theta follows.
        """
        form, p, n = self.form, self.form.p, self.form.n
        size = len(self.lower)

        def formula(x: ca.SX, theta: ca.SX, P: ca.SX, last: ca.SX) -> Results:
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
            clipped = ca.if_else(moved + ca.norm_1(x_in - x) > 0, 1, 0)
            return {
                "x": x_in,
                "theta": self._theta_within(theta, values_in, moved, defined),
                "parameters": values_in,
                "P": ca.densify(J @ P @ J.T),
                "flags": Flags(clipped=clipped, undefined=1 - defined).vector(),
            }

        sizes = {"x": n, "theta": p, "P": Symmetric(size), "last": p}
        return leaf("observed", sizes, formula)

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


def state_bounds(model: Model) -> tuple[Array, Array]:
    """Lower and upper bounds of the states, (nx,) each."""
    return np.array([s.lower for s in model.states]), np.array([s.upper for s in model.states])

"""From what an observer integrates to what the model has: parameters, bounds, covariance."""

import dataclasses

import casadi as ca
import numpy as np

from backsight.algebra.bounds import clip
from backsight.errors import TuningError
from backsight.estimators.parts.flags import Flags
from backsight.estimators.parts.leaf import Results, Symmetric, leaf
from backsight.models.affine import AffineForm, Coordinates
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
        Bounds, in the order of chain, parameters and constants.
    order : list of int
        Which states of the model these are.
    """

    form: AffineForm
    theta0: Array
    lower: Array
    upper: Array
    order: list[int]

    @property
    def places(self) -> list[int]:
        """Where the states of the model are in this order; empty if it is theirs."""
        return [] if self.order == sorted(self.order) else np.argsort(self.order).tolist()

    def joined(self, x: ca.MX, parameters: ca.MX, constants: Array) -> ca.MX:
        """All states in the order of the model."""
        whole = ca.vertcat(x, parameters, constants)
        return whole[self.places] if self.places else whole

    @property
    def parameters(self) -> slice:
        """Where the parameters are among the states."""
        return slice(self.form.n, self.form.n + len(self.form.parameters))

    def observed(self) -> ca.Function:
        """``(x, theta, P, last) -> (x, states, theta, parameters, P, flags)``.

        The chain x goes to the model's states, which are the same if it is made of them, and P from
        the covariance of chain, theta and constants to that of the states. Where a
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
            at = form.coordinates
            states = x if at is None else at.states.call([x])[0]
            inside = clip(states, self.lower[:n], self.upper[:n])
            values_in = clip(values, self.lower[self.parameters], self.upper[self.parameters])
            moved = ca.norm_1(values_in - values) if p else ca.SX(0)
            clipped = ca.if_else(moved + ca.norm_1(inside - states) > 0, 1, 0)
            x_in = inside
            if at is not None:
                x_in = ca.if_else(ca.norm_1(inside - states) > 0, at.chain.call([inside])[0], x)
                slope = ca.sparsify(at.slope.call([states])[0])
                J[:n, :n] = ca.inv(slope)
            P_states = ca.densify(J @ P @ J.T)
            return {
                "x": x_in,
                "states": inside,
                "theta": self._theta_within(theta, values_in, moved, defined),
                "parameters": values_in,
                "P": P_states[self.places, self.places] if self.places else P_states,
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


@dataclasses.dataclass(frozen=True)
class Start:
    """Start, covariance and noise of chain and theta.

    Parameters
    ----------
    x0 : (n,) array
    P0, Q, Qc : (size, size) arrays
        Covariance, what the noise adds per sample, and its spectral density.
    varies : Coordinates, optional
        Of a chain whose slope by the states varies: Q is then still that of the states.
    """

    x0: Array
    P0: Array
    Q: Array
    Qc: Array
    varies: Coordinates | None


def chain_start(
    form: AffineForm, x0: Array, P0: Array, by_theta: Array, *, Q: Array, Qc: Array
) -> Start:
    """Bring prior and noise of the states (chain first) to those of chain, theta and constants.

    Parameters
    ----------
    x0, P0 : arrays
    by_theta : (p, p) array
        Derivative of theta by the parameters.
    Q, Qc : arrays
        See `Start`.
    """
    at, n, p = form.coordinates, form.n, len(by_theta)
    T = np.eye(len(x0))
    T[n : n + p, n : n + p] = by_theta
    of_noise = T.copy()
    if at is not None:
        T[:n, :n] = np.asarray(at.slope(x0[:n]))
        of_noise = T if at.linear else of_noise
    if not np.all(np.isfinite(T)):
        raise TuningError(
            f"at the start {x0[:n].tolist()} the output and its derivatives do not determine "
            f"{', '.join(form.states)}; start elsewhere"
        )
    varies = None if at is None or at.linear else at
    carried = (of_noise @ noise @ of_noise.T for noise in (Q, Qc))
    return Start(form.chain(x0[:n]), T @ P0 @ T.T, *carried, varies)


def state_bounds(model: Model) -> tuple[Array, Array]:
    """Lower and upper bounds of the states, (nx,) each."""
    return np.array([s.lower for s in model.states]), np.array([s.upper for s in model.states])

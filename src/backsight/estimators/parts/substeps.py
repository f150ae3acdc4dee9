"""The model from sample to sample in sub-steps, and its states within their bounds."""

import casadi as ca

from backsight.algebra import bounds
from backsight.discrete.runge_kutta import Integrator
from backsight.discrete.steps import advanced
from backsight.estimators.base import Setting


def flow(s: Setting, integrator: Integrator, x: ca.SX, *, ua: ca.SX, ub: ca.SX, h: float) -> ca.SX:
    """One sub-step of the state, eq. 33-34 of Polóni et al. (2012) for Heun's method."""
    return advanced(integrator, s.model, x, ua=ua, ub=ub, h=h)


def substep_inputs(
    integrator: Integrator, u: ca.MX, u_next: ca.MX
) -> tuple[list[ca.MX], list[ca.MX]]:
    """Inputs at both ends of the sub-steps: as columns (ramp), or once for all (held)."""
    if integrator.hold == "zoh":
        return [], [u, u]
    return ramp(integrator.steps, u, u_next), []


def ramp(n: int, a: ca.MX, b: ca.MX) -> list[ca.MX]:
    """Values at the beginning and at the end of n sub-steps from a to b, side by side."""
    first, last = ca.SX.sym("a", a.numel()), ca.SX.sym("b", b.numel())
    grid = [first + (k / n) * (last - first) for k in range(n + 1)]
    name = f"ramp_{n}_of_{a.numel()}"
    columns = [ca.horzcat(*grid[:-1]), ca.horzcat(*grid[1:])]
    return list(ca.Function(name, [first, last], columns)(a, b))


def within_bounds(s: Setting, x: ca.SX) -> ca.SX:
    """Set states outside their bounds to the bounds."""
    return bounds.clip(x, s.lower, s.upper)

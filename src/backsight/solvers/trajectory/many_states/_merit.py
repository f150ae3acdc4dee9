"""One sample of the merit for many states, see `backsight.solvers.trajectory._merit`."""

import casadi as ca

from backsight.engine.dense import applied, few_entries, product_of
from backsight.solvers.trajectory.chain import Chain
from backsight.solvers.trajectory.many_states._symbols import SampleMatrices, noise_along


def merit_of_many(chain: Chain, limits: ca.Function) -> ca.Function:
    """Add one sample to the sums of `backsight.solvers.trajectory._merit.merit`.

    Parameters
    ----------
    chain : Chain
    limits : casadi.Function
        ``(low, high, value, change) -> (J, slope, violated)`` of the limits.
    """
    nx, n, z = chain.nx, chain.n, SampleMatrices.of(chain)
    stage = z.symbols[: len(chain.sizes)]
    sizes = {"J": 1, "slope": 1, "defects": nx + n, "adjoints": nx + n, "steps": nx}
    J, slope, defects, adjoints, steps = sums = [ca.MX.sym(k, size) for k, size in sizes.items()]
    eta, x, eta_next = paths = [ca.MX.sym(k, nx) for k in ("eta", "dX", "eta_next")]
    nu = ca.MX.sym("nu", n)
    w, dw = (noise_along(chain, z.before, k) for k in (eta, eta_next - eta))
    J_next = J + (inner(z.e, z.e) + inner(eta, w)) / 2
    slope_next = slope - inner(z.e, applied(z.H, x)) + inner(eta, dw)
    # Of the adjoint of the noise only this is the multiplier of the defects, see `_merit`.
    lam, violated = eta_next, ca.MX.zeros(0, 1)
    if n:
        noise = few_entries(chain.noise)
        lam = eta_next - applied(noise, nu, turned=True)
        change = applied(noise, dw) + product_of(z.A, x)
        more, steeper, violated = limits(*stage[6:8], applied(noise, w), change)
        J_next, slope_next = J_next + more, slope_next + steeper
    results = [
        J_next,
        slope_next,
        defects + ca.vertcat(ca.fabs(z.c + w), violated),
        ca.fmax(adjoints, ca.fabs(ca.vertcat(lam, nu))),
        ca.fmax(steps, ca.fabs(x)),
    ]
    return ca.Function("merit_of_many", [*sums, *stage, *paths, nu], results)


def inner(a: ca.MX, b: ca.MX) -> ca.MX:
    """a' b of columns."""
    return product_of(a, b, turned=(True, False))


def times_stored(P: ca.MX, eta: ca.MX) -> ca.MX:
    """P eta of a stored covariance."""
    return product_of(ca.reshape(P, eta.numel(), eta.numel()), eta)

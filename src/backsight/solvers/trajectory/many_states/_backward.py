"""One sample of the backward pass for many states, see `backsight.solvers.trajectory._adjoint`."""

import casadi as ca

from backsight.engine.dense import applied, few_entries, product_of
from backsight.solvers.trajectory.chain import Chain
from backsight.solvers.trajectory.many_states._symbols import SampleMatrices, noise_along, recorded


def backward_of_many(chain: Chain, told: ca.Function) -> ca.Function:
    """The carry is the adjoint after its update, the number of wrong limits, and the residual.

    Parameters
    ----------
    chain : Chain
    told : casadi.Function
        ``(low, high, side, nu, g, value, enter) -> (side, wrong, broken)`` of the limits.
    """
    nx, z, past = chain.nx, SampleMatrices.of(chain), recorded(chain)
    lam, enter = ca.MX.sym("lam", nx), ca.MX.sym("enter")
    wrong, residual = ca.MX.sym("wrong"), ca.MX.sym("residual")
    # Given the whole window the mean is x = d + P lam, with lam after the sample's updates.
    x = past["delta"] + product_of(ca.reshape(past["P"], nx, nx), lam)
    # Before the update by all outputs the adjoint is lam + H' (S^-1 e - K' lam).
    K_y = ca.reshape(past["K_y"], nx, chain.ny)
    nu_y = past["nu_y"] - applied(K_y, lam, turned=True)
    left = ca.fmax(residual, ca.norm_inf(nu_y - z.e + applied(z.H, x)))
    adj = lam + applied(z.H, nu_y, turned=True)
    adj, eta, nu = _limits(chain, z, past, adj)
    # What is left is the adjoint of the transition; with the limits on its noise that of the noise.
    w = noise_along(chain, z.before, eta)
    value = ca.MX.zeros(0, 1)
    if chain.n:
        value = product_of(z.A, x) + applied(few_entries(chain.noise), w)
    side, change, broken = told(*z.symbols[6:9], nu, past["g"], value, enter)
    back = applied(z.F, adj, turned=True)
    results = [back, wrong + change, left, x, eta, nu, side, value, broken]
    inputs = [lam, wrong, residual, *past.values(), *z.symbols, enter]
    return ca.Function("backward_of_many", inputs, results)


def _limits(
    chain: Chain, z: SampleMatrices, past: dict[str, ca.MX], adj: ca.MX
) -> tuple[ca.MX, ca.MX, ca.MX]:
    """Adjoints of the transition and of its noise, and the multipliers of the limits."""
    K, nus = ca.reshape(past["K"], chain.nx, chain.n), {}
    on_noise = [r for r in range(chain.n) if chain.noise[r].any()]
    for r in reversed([r for r in range(chain.n) if r not in on_noise]):
        nus[r] = past["nu"][r] - product_of(K[:, r], adj, turned=(True, False))
        adj = adj + z.A[r, :].T * nus[r]
    eta = adj
    for r in reversed(on_noise):
        nus[r] = past["nu"][r] - product_of(K[:, r], eta, turned=(True, False))
        eta = eta + ca.MX(ca.DM(chain.noise[r])) * nus[r]
    return adj, eta, ca.vertcat(ca.MX(0, 1), *(nus[r] for r in range(chain.n)))

"""Information of the adjoint for many states, see `backsight.solvers.trajectory._smoothed`."""

import casadi as ca

from backsight.engine.dense import (
    add_product,
    all_entries,
    plus_product,
    product_of,
    solve_triangular,
    symmetrise,
    transpose,
)
from backsight.solvers.trajectory.chain import Chain
from backsight.solvers.trajectory.many_states._symbols import SampleMatrices, recorded


def information_of_many(chain: Chain) -> ca.Function:
    """Information of the adjoint, from after the update of a sample back to the sample before."""
    nx, vL, past, z = (
        chain.nx,
        ca.MX.sym("L", chain.size_P),
        recorded(chain),
        SampleMatrices.of(chain),
    )
    K_y, L = ca.reshape(past["K_y"], nx, chain.ny), ca.reshape(vL, nx, nx)
    # The outputs, which were taken in last: (I - K H)' L (I - K H) + H' S^-1 H.
    H = all_entries(z.H)
    factor = ca.reshape(past["g_y"], chain.ny, chain.ny)
    LK = product_of(L, K_y)
    left = plus_product(L, H, LK, turned=(True, True), minus=True)
    white = solve_triangular(factor, H)
    L = plus_product(
        plus_product(left, product_of(left, K_y), H, minus=True), white, white, turned=(True, False)
    )
    # The limits on the state, one after the other.
    K = ca.reshape(past["K"], nx, chain.n)
    for r in reversed(range(chain.n)):
        if not chain.noise[r].any():
            row, gain = z.A[r, :].T, K[:, r]
            left = add_product(L, -row, product_of(L, gain))
            L = add_product(left, past["g"][r] * row - product_of(left, gain), row)
    half = transpose(add_product(ca.MX.zeros(nx, nx), L, z.F, turned=False))
    back = symmetrise(add_product(ca.MX.zeros(nx, nx), half, z.F, turned=False))
    return ca.Function("information", [vL, *past.values(), *z.symbols], [ca.vec(back)])


def reduced_of_many(chain: Chain) -> ca.Function:
    """P - P L P."""
    nx = chain.nx
    vP, vL = (ca.MX.sym(k, chain.size_P) for k in "PL")
    P, L = (ca.reshape(k, nx, nx) for k in (vP, vL))
    less = plus_product(P, product_of(P, L), P, minus=True)
    return ca.Function("reduced", [vP, vL], [ca.vec(symmetrise(less))])

r"""A linear Gaussian trajectory with bounds that are imposed as exact measurements.

One forward pass of a Kalman filter in covariance form and one backward pass of adjoints
(Bryson and Frazier) solve

.. math:: \min\; \tfrac12 (\delta_0 - \bar\delta)' P^{-1} (\delta_0 - \bar\delta)
   + \tfrac12 \sum w_i' Q^{-1} w_i + \tfrac12 \sum |e_i - H_i \delta_i|^2, \qquad
   \delta_{i+1} = F_i \delta_i + c_i + w_i

with equations :math:`a' \delta_i = t` of some rows. No covariance is ever inverted: P and Q may be
singular. The adjoint :math:`\lambda_i` gives :math:`w_{i-1} = Q \lambda_i` and the multiplier of
every equation.

Source: Bierman, "Fixed interval smoothing with discrete measurements", 1973,
doi:10.1080/00207177308932487.
"""

import casadi as ca

from backsight.algebra.symmetric import unvech, vech
from backsight.engine.loops import scan
from backsight.solvers.trajectory import many_states
from backsight.solvers.trajectory._imposed import impose, limited_noise, limited_sizes, symmetric
from backsight.solvers.trajectory.chain import Chain, Stage, naming


def forward_pass(chain: Chain) -> ca.Function:
    """Forward pass: ``(delta, P, *stages, side, force) -> records``.

    ``delta`` and ``P`` describe the first sample before its measurements. The others are columns
    side by side: what describes the samples; 1 for limits that are active at their lower end, -1 at
    their upper one, else 0; multipliers of limits that are not active.

    The records are ``delta, P, K, nu, g, K_y, nu_y, g_y, conflict, size``: mean and covariance
    after the sample, then gains K, innovations divided by their variance nu and one over the
    variance g, of the limits and of the outputs. Limits that are not active have the gain 0; active
    ones that have no room to move, too, and are in conflict if they are not met already. ``size``
    is the variance of the limited quantities before anything cancels.
    """
    delta, P = ca.MX.sym("delta", chain.nx), ca.MX.sym("P", chain.size_P)
    stages = [ca.MX.sym(k, size, chain.N + 1) for k, size in chain.inputs.items()]
    _, records = scan(_forward(chain), chain.N + 1, carry=[delta, P], xs=stages)
    return naming("filtered", [delta, P, *stages], dict(zip(chain.records, records, strict=True)))


def end_covariance(chain: Chain) -> ca.Function:
    """``(delta, P, *stages, side, force) -> P`` of the last sample, given all of them."""
    delta, P = ca.MX.sym("delta", chain.nx), ca.MX.sym("P", chain.size_P)
    stages = [ca.MX.sym(k, size, chain.N + 1) for k, size in chain.inputs.items()]
    (_, P_end), _ = scan(_forward(chain), chain.N + 1, carry=[delta, P], xs=stages)
    return ca.Function("end_covariance", [delta, P, *stages], [P_end])


def _forward(chain: Chain) -> ca.Function:
    """Transition to a sample and its update; before the first sample nothing moves."""
    delta, P = ca.MX.sym("delta", chain.nx), ca.MX.sym("P", chain.size_P)
    stage = [ca.MX.sym(k, size) for k, size in chain.inputs.items()]
    d, P_after, *records = update(chain)(*transit(chain)(delta, P, *stage), *stage)
    return ca.Function("forward", [delta, P, *stage], [d, P_after, d, P_after, *records])


def transit(chain: Chain) -> ca.Function:
    """``(delta, P, *stage) -> (delta, P, size, K, nu, conflict)`` over one transition.

    ``K``, ``nu`` and ``conflict`` are those of limits on the noise, see `filtered`.
    """
    return many_states.transit_of_many(chain) if chain.dense else _transit(chain)


def update(chain: Chain) -> ca.Function:
    """``(delta, P, size, K, nu, conflict, *stage) -> records``, see `filtered`.

    First the limits on the state, then the outputs, one row after the other; of many states all
    outputs at once, see `many_states`.
    """
    return many_states.update_of_many(chain) if chain.dense else _update(chain)


def _transit(chain: Chain) -> ca.Function:
    d, vP, z = ca.SX.sym("delta", chain.nx), ca.SX.sym("P", chain.size_P), Stage.of(chain)
    F, P = ca.SX(chain.F, z.F), unvech(vP)
    w, Qw, *limited = limited_noise(chain, z)
    P_next = F @ P @ F.T + Qw
    return ca.Function(
        "transit",
        [d, vP, *z.symbols],
        [
            F @ d + z.c + w,
            vech(ca.densify(P_next)),
            limited_sizes(chain, z, ca.diag(P), Qw),
            *limited,
        ],
    )


def _update(chain: Chain) -> ca.Function:
    nx, z = chain.nx, Stage.of(chain)
    d, vP = ca.SX.sym("delta", nx), ca.SX.sym("P", chain.size_P)
    size, nu_w, bad = (ca.SX.sym(k, chain.n) for k in ("size", "nu", "conflict"))
    K_w = ca.SX.sym("K", nx, chain.n)
    A, H, P = ca.SX(chain.A, z.A), ca.SX(chain.H, z.H), unvech(vP)
    K, nu, conflict = ca.SX(K_w), ca.SX(nu_w), ca.SX(bad)
    x, g, g_y = d, ca.SX.zeros(chain.n), ca.SX.zeros(chain.ny)
    for r in range(chain.n):
        if not chain.noise[r].any():
            x, P, K[:, r], nu[r], g[r], conflict[r] = impose(chain, z, r, x, P, A[r, :].T, size[r])
    K_y, nu_y = ca.SX.zeros(nx, chain.ny), ca.SX.zeros(chain.ny)
    for j in range(chain.ny):
        h = H[j, :].T
        v = P @ h
        S = ca.dot(h, v) + 1
        g_y[j] = 1 / S
        K_y[:, j] = v * g_y[j]
        nu_y[j] = (z.e[j] - ca.dot(h, x)) * g_y[j]
        x = x + v * nu_y[j]
        left = P - K_y[:, j] @ v.T
        P = symmetric(left - (left @ h - K_y[:, j]) @ K_y[:, j].T)
    return ca.Function(
        "update",
        [d, vP, size, K_w, nu_w, bad, *z.symbols],
        [
            ca.densify(x), vech(ca.densify(P)), ca.vec(K), nu, g,
            ca.vec(K_y), nu_y, g_y, conflict, size,
        ],
    )  # fmt: skip

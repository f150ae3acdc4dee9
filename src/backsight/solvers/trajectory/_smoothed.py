"""Covariances of the samples of a linear window, given all of it."""

import casadi as ca

from backsight.algebra.symmetric import unvech, vech
from backsight.engine.loops import scan
from backsight.solvers.trajectory import many_states
from backsight.solvers.trajectory._imposed import symmetric
from backsight.solvers.trajectory.chain import Chain, Stage
from backsight.solvers.trajectory.smoother import forward_pass


def smoothed(chain: Chain, back: int) -> ca.Function:
    r"""Covariance of the sample `back` samples before the last one, given all of them.

    ``(delta, P, *stages, side, force) -> P``. The information :math:`\Lambda_i` of the adjoint is
    carried back, and the covariance is :math:`P_i - P_i \Lambda_i P_i`.
    """
    nx, n = chain.nx, chain.N + 1
    delta, P = ca.MX.sym("delta", nx), ca.MX.sym("P", chain.size_P)
    stages = [ca.MX.sym(k, size, n) for k, size in chain.inputs.items()]
    records = forward_pass(chain)(delta, P, *stages)
    if back == 0:
        return ca.Function("smoothed", [delta, P, *stages], [records[1][:, n - 1]])
    part = slice(n - back, n)
    (Lambda,), _ = scan(
        _information(chain),
        back,
        carry=[ca.MX.zeros(P.numel())],
        xs=[k[:, part] for k in (*records, *stages)],
        backward=True,
    )
    left = _reduced(chain)(records[1][:, n - 1 - back], Lambda)
    return ca.Function("smoothed", [delta, P, *stages], [left])


def smoothed_all(chain: Chain) -> ca.Function:
    """As `smoothed`, of all samples side by side."""
    nx, n = chain.nx, chain.N + 1
    delta, P = ca.MX.sym("delta", nx), ca.MX.sym("P", chain.size_P)
    stages = [ca.MX.sym(k, size, n) for k, size in chain.inputs.items()]
    records = forward_pass(chain)(delta, P, *stages)
    Lambda = ca.MX.sym("L", P.numel())
    sizes = chain.records | chain.inputs
    sample = [ca.MX.sym(k, size) for k, size in sizes.items()]
    body = ca.Function(
        "smoothed_sample",
        [Lambda, *sample],
        [_information(chain)(Lambda, *sample), _reduced(chain)(sample[1], Lambda)],
    )
    _, (covariances,) = scan(
        body, n, carry=[ca.MX.zeros(P.numel())], xs=[*records, *stages], backward=True
    )
    return ca.Function("smoothed_all", [delta, P, *stages], [covariances])


def _information(chain: Chain) -> ca.Function:
    """Information of the adjoint, from after the update of a sample back to the sample before."""
    if chain.dense:
        return many_states.information_of_many(chain)
    z, vL = Stage.of(chain), ca.SX.sym("L", chain.size_P)
    records = [ca.SX.sym(k, size) for k, size in chain.records.items()]
    F, L = ca.SX(chain.F, z.F), chain.matrix(vL)
    for K, a, g in _rows(chain, records, ca.SX(chain.A, z.A), ca.SX(chain.H, z.H)):
        LK = L @ K
        left = L - a @ LK.T
        L = symmetric(ca.densify(left - (left @ K - g * a) @ a.T))
    return ca.Function("information", [vL, *records, *z.symbols], [vech(ca.densify(F.T @ L @ F))])


def _rows(chain: Chain, records: list, A, H) -> list[tuple]:
    """Gain, row and one over the variance of every scalar update, the last one first.

    Before an update the information is (I - a K') L (I - K a') + g a a'.
    """
    z = dict(zip(chain.records, records, strict=True))
    g, g_y = z["g"], z["g_y"]
    K, K_y = ca.reshape(z["K"], chain.nx, chain.n), ca.reshape(z["K_y"], chain.nx, chain.ny)
    outputs = [(K_y[:, j], H[j, :].T, g_y[j]) for j in range(chain.ny)]
    on_state = [r for r in range(chain.n) if not chain.noise[r].any()]
    limits = [(K[:, r], A[r, :].T, g[r]) for r in on_state]
    return [*limits, *outputs][::-1]


def _reduced(chain: Chain) -> ca.Function:
    """P - P L P."""
    if chain.dense:
        return many_states.reduced_of_many(chain)
    vP, vL = (ca.SX.sym(k, chain.size_P) for k in "PL")
    P, L = unvech(vP), unvech(vL)
    return ca.Function("reduced", [vP, vL], [vech(P - P @ L @ P)])

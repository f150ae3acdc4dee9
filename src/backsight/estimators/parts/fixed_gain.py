"""Correction with a gain that was computed beforehand."""

import casadi as ca

from backsight.algebra.symmetric import unvech, vech
from backsight.algebra.update import joseph, measured, noise_of
from backsight.engine.dense import add_product, symmetrise
from backsight.estimators.parts.gaussian import clip
from backsight.estimators.parts.linear import Linear, is_large
from backsight.types import Array


def correct_with(system: Linear, K: Array) -> ca.Function:
    """Measurement update ``(x, P, u, y, mask) -> (x, P, flags)`` with the gain K (nx, ny).

    Rows that were not measured are left out. P is the covariance of the estimate that this gain
    makes, by Joseph's formula; it holds for every gain. States outside their bounds are set to
    them.
    """
    s = system.s
    nx, nu, ny = s.model.nx, s.model.nu, s.model.ny
    x, u, y, mask = (ca.SX.sym(n, k) for n, k in (("x", nx), ("u", nu), ("y", ny), ("m", ny)))
    seen = measured(mask)
    e = seen * (y - s.model.output(x, u))
    free = x + ca.mtimes(ca.DM(K), e)
    moved = clip(s, free)
    clipped = ca.if_else(ca.norm_1(moved - free) > 0, 1, 0)
    flags = ca.vertcat(clipped, 0, 0, 0)
    masked, R = ca.SX(ca.DM(K)) @ ca.diag(seen), noise_of(ca.SX(s.R), mask)
    if not is_large(system):
        vP = ca.SX.sym("P", nx * (nx + 1) // 2)
        P = joseph(unvech(vP), masked, ca.SX(ca.sparsify(ca.DM(system.C))), R)
        return ca.Function("correct", [x, vP, u, y, mask], [moved, vech(P), flags])
    state = ca.Function("state", [x, u, y, mask], [moved, flags])
    gain = ca.Function("gain", [mask], [ca.densify(masked), ca.densify(masked @ R)])
    inputs = [ca.MX.sym(n, k) for n, k in (("x", nx), ("P", nx * nx), ("u", nu), ("y", ny))]
    inputs.append(ca.MX.sym("mask", ny))
    x_post, raised = state(inputs[0], *inputs[2:])
    P_post = _joseph_by_loops(ca.reshape(inputs[1], nx, nx), list(gain(inputs[4])), system)
    return ca.Function("correct", inputs, [x_post, ca.vec(P_post), raised])


def _joseph_by_loops(P: ca.MX, gains: list[ca.MX], system: Linear) -> ca.MX:
    """(I - K C) P (I - K C)' + K R K' as products of tall matrices."""
    K, KR = gains
    nx, ny = K.shape
    C = ca.MX(ca.sparsify(ca.DM(system.C)))
    PCt = add_product(ca.MX.zeros(nx, ny), P, C)
    left = add_product(P, -K, PCt)
    leftCt = add_product(ca.MX.zeros(nx, ny), left, C)
    return symmetrise(add_product(add_product(left, -leftCt, K), KR, K))

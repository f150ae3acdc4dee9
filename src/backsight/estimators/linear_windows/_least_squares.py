"""Least squares over a window of a linear model: by constant gains, or sample by sample."""

from collections.abc import Sequence

import casadi as ca

from backsight.engine.loops import iterate, scan
from backsight.estimators.linear_windows._window_filter import window_filter
from backsight.estimators.linear_windows.stacked import gains, product
from backsight.estimators.parts.covariance import Covariance, packed
from backsight.estimators.parts.filtering import choose
from backsight.estimators.parts.linear import Linear, Varying
from backsight.estimators.scaled import Setting
from backsight.estimators.varied_number import varied_at

Window = Sequence[ca.MX]
"""Inputs, outputs, masks and presence of the samples, side by side."""

DEFICIENT = 2
"""Place of the flag among the results of `window_filter`."""


def least_squares(
    system: Linear | Varying,
    N: int,
    arrival_weight: float,
    start: Sequence[ca.MX],
    window: Window,
    *,
    samples: Sequence[int],
) -> list[ca.MX]:
    """Solve a window without its limits: 1 if its measurements do not suffice, x and P of samples.

    The samples are the last one, or the last and the first. A full window without gaps of a model
    with constant coefficients and noise is a product with constant gains; others are gone through
    sample by sample.
    """
    U, Y, M, present = window
    through = window_filter(system, N)
    constant = isinstance(system, Linear) and not system.s.parts
    whole = _all(M) if constant else ca.MX(0)
    go, diffuse, P_lead = start_of(system.s, arrival_weight)(whole, present[0], start[1], U[:, -1])
    results = [through.size_out(i) for i in range(through.n_out()) if i != DEFICIENT]
    found = [ca.MX.zeros(*size) for size in results[: 2 * len(samples)]]
    if arrival_weight == 0 and isinstance(system, Linear) and constant:
        fixed = [gains(system, N, at=at) for at in samples]
        found = [
            k
            for g in fixed
            for k in (
                product(g.M, ca.vec(Y)) + product(g.N_u, ca.vec(U)),
                ca.MX(packed(g.P)),
            )
        ]
    last = iterate(
        _pass(through, len(found)),
        2,
        carry=[go, diffuse, ca.MX(0), *found],
        constants=[start[0], P_lead, start[1], *window],
    )
    return last[2:]


def _all(M: ca.MX) -> ca.MX:
    """1 if every sample of the window was measured, and with the nominal noise."""
    ny, n = M.shape
    so_far, mask = ca.SX.sym("so_far"), ca.SX.sym("mask", ny)
    body = ca.Function("all", [so_far, mask], [ca.fmin(so_far, ca.mmin(mask == 1))])
    return scan(body, n, carry=[ca.MX(1)], xs=[M])[0][0]


def start_of(s: Setting, arrival_weight: float) -> ca.Function:
    """Whether to go through the window, whether its start is unknown, and its covariance.

    ``(measured, full, P, u) -> (go, diffuse, P)``
    """
    measured, full = ca.SX.sym("measured"), ca.SX.sym("full")
    u, weight = ca.SX.sym("u", s.model.nu), ca.SX(1)
    if arrival_weight == 0:
        plan = [1 - full * measured, full]
    else:
        plan = [ca.SX(1), ca.SX(0)]
        weight = ca.if_else(full, varied_at(arrival_weight, u), 1)
    if not Covariance(s.model.nx).whole:
        P = ca.SX.sym("P", len(packed(s.P0)))
        return ca.Function("plan", [measured, full, P, u], [*plan, P / weight])
    chosen = ca.Function("plan_of", [measured, full, u], [*plan, weight])
    given = [ca.MX.sym(n, k) for n, k in (("m", 1), ("f", 1), ("P", len(packed(s.P0))))]
    v = ca.MX.sym("u", s.model.nu)
    *scalars, by = chosen(given[0], given[1], v)
    return ca.Function("plan", [*given, v], [*scalars, given[2] / by])


def _pass(through: ca.Function, wanted: int) -> ca.Function:
    """Go through the window; where nothing is known of its start, but must be, once more.

    Of the results of `window_filter` only so many are wanted.
    """
    start = [ca.MX.sym(through.name_in(i), *through.size_in(i)) for i in range(through.n_in())]
    x_start, P_lead, diffuse, *window = start
    P_start = ca.MX.sym("P_start", P_lead.numel())
    go, lacking = ca.MX.sym("go"), ca.MX.sym("lacking")
    (P,) = choose(lacking, [P_start], [P_lead])
    x, P_now, deficient, *more = through(x_start, P, diffuse, *window)
    (lacks,) = choose(deficient, [ca.MX(1)], [lacking])
    results = [x, P_now, *more][:wanted]
    ignored = [ca.MX.sym(f"r{i}", *r.shape) for i, r in enumerate(results)]
    return ca.Function(
        "pass",
        [go, diffuse, lacking, *ignored, x_start, P_lead, P_start, *window],
        [deficient, ca.MX(0), lacks, *results],
    )

"""What is said of the estimate of a window, and its covariance as it is put out."""

import casadi as ca
import numpy as np

from backsight.algebra.symmetric import vech
from backsight.engine.dense import diagonal, triangle
from backsight.estimators.parts.flags import Flags
from backsight.estimators.parts.leaf import Results, leaf
from backsight.estimators.scaled import Setting
from backsight.solvers.trajectory import Chain

NEGATIVE = -1e-10
"""Variances below this share of the sample's variance before it was measured are no rounding."""


def verdict_of_window(chain: Chain, s: Setting) -> ca.Function:
    """Limits that contradict each other, whether there are any, flags, and P.

    ``(side, conflict, limit, unfinished, rejected, P, P_prior) -> (names, infeasible, flags, P)``.
    P is then its lower triangle, without variances that are below zero by rounding.
    """
    n = chain.n
    bounds = [r for r in range(n) if r not in chain.exact]
    # What a sensor without noise has told has no variance, but the rounding of what it had.
    least = ca.SX(ca.DM(np.diag(s.P0) if chain.exact else np.zeros(chain.nx)))

    def formula(
        side: ca.SX, conflict: ca.SX, limit: ca.SX, unfinished: ca.SX, rejected: ca.SX,
        variance: ca.SX, variance_prior: ca.SX,
    ) -> Results:  # fmt: skip
        allowed = NEGATIVE * ca.fmax(ca.fabs(variance_prior), least)
        names = ca.vertcat(ca.SX(0, 1), *(ca.mmax(conflict[r, :]) for r in range(n)))
        infeasible = ca.mmax(names) if n else ca.SX(0)
        flags = Flags(
            clipped=ca.mmax(ca.fabs(side[bounds])) if bounds else 0,
            iteration_limit=ca.fmax(limit, unfinished),
            step_rejected=rejected,
            not_positive_definite=ca.mmax(allowed - variance) > 0,
            infeasible=infeasible,
        )
        said = {"names": names, "infeasible": infeasible, "flags": flags.vector()}
        return {**said, "missing": ca.fmax(-variance, 0)}

    course = {"limit": 1, "unfinished": 1, "rejected": 1, "variance": chain.nx}
    sizes = {"side": n, "conflict": (n, chain.N + 1), **course}
    judged = leaf("verdict", sizes, formula)
    given = [ca.MX.sym(judged.name_in(k), *judged.size_in(k)) for k in range(5)]
    P, P_prior = ca.MX.sym("P", chain.size_P), ca.MX.sym("P_prior", chain.size_P)
    *said, missing = judged(*given, chain.variances(P), chain.variances(P_prior))
    results = [*said, _without_negative(chain)(P, missing)]
    return ca.Function("verdict_of_window", [*given, P, P_prior], results)


def _without_negative(chain: Chain) -> ca.Function:
    """``(P, missing) -> triangle``: a stored covariance with what its diagonal is below zero."""
    if chain.dense:
        nx, P = chain.nx, ca.MX.sym("P", chain.size_P)
        missing = ca.MX.sym("missing", nx)
        whole = ca.reshape(P, nx, nx) + diagonal(missing)
        return ca.Function("without_negative", [P, missing], [triangle(whole)])
    P, missing = ca.SX.sym("P", chain.size_P), ca.SX.sym("missing", chain.nx)
    clean = vech(ca.densify(chain.matrix(P) + ca.diag(missing)))
    return ca.Function("without_negative", [P, missing], [clean])

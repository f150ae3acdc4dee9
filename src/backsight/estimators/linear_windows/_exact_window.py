r"""A window of which nothing is known before, with sensors that have no noise: by equations.

An exact reading has no weight of least squares, and the first state no covariance. So from the last
sample back to the first what the readings tell is kept as equations with the factor of their noise
(see `backsight.estimators.smoothing._equations`), beside the state that is wanted, the last one,

.. math:: A_k x_k = \zeta_k + N_k \varepsilon, \qquad
    x_N = B_k x_k + b_k + M_k \varepsilon, \qquad \varepsilon \sim N(0, I) .

Readings are joined, and noise is gathered, by orthogonal transformations only. At the first sample
the equations say what :math:`x_0` is, or together with a prior.

Source: as in `backsight.estimators.smoothing._equations`.
"""

from collections.abc import Sequence

import casadi as ca
import numpy as np

from backsight.algebra.factor import cholesky_semidefinite
from backsight.algebra.triangular import fixed_directions
from backsight.algebra.update import masked
from backsight.engine.loops import scan
from backsight.errors import TuningError
from backsight.estimators.parts.covariance import (
    Covariance,
    Term,
    matrix_product,
    times_transposed,
)
from backsight.estimators.parts.factors import (
    cholesky,
    compress_rows,
    on_top,
    solve_upper_semidefinite,
    with_fixed,
)
from backsight.estimators.parts.filtering import choose
from backsight.estimators.parts.flags import Flags
from backsight.estimators.parts.leaf import Results, Size, Symmetric, half, leaf, notation
from backsight.estimators.parts.limits import Limits
from backsight.estimators.parts.linear import Linear, Varying, root
from backsight.estimators.smoothing import NOTHING, known_by, of_size_one, turned

DEFICIENT = 1e-10
"""Share of an equation below which what it says of a state is rounding."""


def exactly_solved(
    system: Linear | Varying,
    limits: Limits,
    N: int,
    start: Sequence[ca.MX],
    window: Sequence[ca.MX],
) -> dict[str, ca.MX]:
    """x, P and flags of the last sample of a window.

    Where it does not determine its first state, the prior stands in for what is missing.

    Raises
    ------
    TuningError
        With limits, matrices that change, or noise that inputs multiply.
    """
    if isinstance(system, Varying) or system.s.parts or len(limits.names) > len(limits.exact):
        raise TuningError(
            "sensors without noise go with limits, matrices that change and noise that inputs "
            "multiply where something is known before the window: arrival_weight > 0"
        )
    through, full = exact_window(system, N), window[3][0]
    x, P, lacking, redundant = through(*start, full, *window)
    x, P = choose(lacking, list(through(*start, ca.MX(0), *window))[:2], [x, P])
    return {"x": x, "P": P, "flags": Flags(unobserved=lacking, redundant=redundant).vector()}


def exact_window(system: Linear, N: int) -> ca.Function:
    """``(x, P, diffuse, U, Y, M, present) -> (x, P, deficient, redundant)``, as `window_filter`.

    ``redundant`` is 1 if a reading told what others tell exactly; it is left out.
    """
    s = system.s
    nx, nu, ny = s.model.nx, s.model.nu, s.model.ny
    x, vP = ca.MX.sym("x", nx), ca.MX.sym("P", nx * (nx + 1) // 2)
    diffuse, present = ca.MX.sym("diffuse"), ca.MX.sym("present", 1, N + 1)
    U, Y, M = (ca.MX.sym(n, k, N + 1) for n, k in (("U", nu), ("Y", ny), ("M", ny)))
    none = ca.DM.zeros(nx, nx).full()
    told = [none, np.hstack([np.eye(nx), none]), np.zeros(nx)]
    wanted = [np.eye(nx), np.hstack([none, none]), np.zeros(nx)]
    start = [ca.MX(ca.DM(k)) for k in (*told, *wanted, np.zeros(1))]
    join, back = _joined(system), _back(system)
    both, _ = scan(
        _sample(join, back),
        N,
        carry=start,
        xs=[U[:, :-1], U[:, 1:], Y[:, 1:], M[:, 1:], present[:, :-1], present[:, 1:]],
        backward=True,
    )
    gathered = join(*both, U[:, 0], Y[:, 0], M[:, 0], present[0])
    *flat, deficient = _without_prior(system)(*gathered)
    whole = Covariance(nx).of_triangle()(vP)
    (x_end, P_end) = choose(diffuse, flat, list(_with_prior(system)(*gathered, x, whole)))
    results = [x_end, Covariance(nx).triangle()(P_end), diffuse * deficient, gathered[-1]]
    return ca.Function("exact_window", [x, vP, diffuse, U, Y, M, present], results)


def _sizes(system: Linear) -> dict[str, Size]:
    nx = system.s.model.nx
    return {
        **notation(system.s), "A": (nx, nx), "N": (nx, 2 * nx), "zeta": nx, "B": (nx, nx),
        "M": (nx, 2 * nx), "b": nx, "redundant": 1, "here": 1, "before": 1, "P": Symmetric(nx),
        "H": (len(system.C), nx), "noise": (len(system.C), len(system.C)),
    }  # fmt: skip


def _sample(join: ca.Function, back: ca.Function) -> ca.Function:
    """Take in the readings of a sample and go back to the one before."""
    carry = [ca.MX.sym(f"c{k}", *join.size_in(k)) for k in range(7)]
    u_last, u = (ca.MX.sym(k, join.numel_in(7)) for k in ("u_last", "u"))
    y, mask = (ca.MX.sym(k, join.numel_in(8)) for k in ("y", "mask"))
    before, here = ca.MX.sym("before"), ca.MX.sym("here")
    told = join(*carry, u, y, mask, here)
    given = [*carry, u_last, u, y, mask, before, here]
    return ca.Function("exact_sample", given, [*back(*told[:6], u_last, u, before), told[6]])


def _joined(system: Linear) -> ca.Function:
    """Equations with the readings of a sample: ``(*carry, u, y, mask, here) -> carry``."""
    s, nx, ny = system.s, system.s.model.nx, system.s.model.ny
    C, D = ca.SX(ca.sparsify(ca.DM(system.C))), ca.sparsify(ca.DM(system.D))

    def readings(u: ca.SX, y: ca.SX, mask: ca.SX, here: ca.SX) -> Results:
        H, e, R = masked(C, y - ca.mtimes(D, u), ca.SX(s.R), here * mask)
        return {"H": ca.densify(H), "e": e, "noise": ca.densify(cholesky_semidefinite(R))}

    def directions(told: ca.SX) -> Results:
        V, fixed, follows = fixed_directions(told[:, :-1], told[:, -1], least=NOTHING)
        return {"V": V, "fixed": ca.densify(fixed), "follows": follows}

    sizes = {**_sizes(system), "told": (ny, 2 * nx + ny + 1)}
    read, fix = leaf("exact_readings", sizes, readings), leaf("exact_told", sizes, directions)

    def formula(
        A: Term, N: Term, zeta: Term, B: Term, M: Term, b: Term, redundant: Term, u: Term, y: Term,
        mask: Term, here: Term,
    ) -> Results:  # fmt: skip
        zeros = type(A).zeros
        H, noise, e = of_size_one(*(read(u, y, mask, here)[k] for k in (0, 2, 1)))
        rows = [
            ca.horzcat(A, N, zeros(nx, ny), zeta),
            ca.horzcat(H, zeros(ny, 2 * nx), noise, e),
        ]
        rest = turned(on_top([ca.densify(row) for row in rows]), nx)
        V, fixed, follows = fix(ca.densify(rest[nx : nx + ny, nx:]))
        both = on_top([ca.densify(rest[:nx, nx:-1]), ca.densify(ca.horzcat(M, zeros(nx, ny)))])
        both, moved = with_fixed(both, zeros(2 * nx, 1), V, fixed)
        left = compress_rows(ca.densify(both))
        A, N, zeta = of_size_one(rest[:nx, :nx], left[:nx, :], rest[:nx, -1] - moved[:nx])
        results = {
            "A": A, "N": N, "zeta": zeta, "B": B, "M": left[nx:, :], "b": b - moved[nx:],
            "redundant": ca.fmax(redundant, ca.fmin(follows, 1)),
        }  # fmt: skip
        return {name: ca.densify(value) for name, value in results.items()}

    return half("exact_joined", s, formula, sizes)


def _back(system: Linear) -> ca.Function:
    """Through x = F x_last + c + G w: ``(A, N, zeta, B, M, b, u, u_next, before)``."""
    s, nx = system.s, system.s.model.nx
    F, G = ca.DM(system.A), ca.DM(root(s.Q))
    by_u, by_next = ca.DM(system.B), ca.DM(system.B_next)

    def formula(
        A: Term, N: Term, zeta: Term, B: Term, M: Term, b: Term, u: Term, u_next: Term, before: Term
    ) -> Results:
        kind = type(A)
        moved = before * kind(F) + (1 - before) * kind(ca.DM.eye(nx))
        drive = before * kind(G)
        c = before * (matrix_product(kind(by_u), u) + matrix_product(kind(by_next), u_next))
        parts = [
            ca.horzcat(N, -matrix_product(A, drive)),
            ca.horzcat(M, matrix_product(B, drive)),
        ]
        noise = compress_rows(on_top([ca.densify(part) for part in parts]))
        results = {
            "A": matrix_product(A, ca.densify(moved)), "N": noise[:nx, :],
            "zeta": zeta - matrix_product(A, c), "B": matrix_product(B, ca.densify(moved)),
            "M": noise[nx:, :], "b": b + matrix_product(B, c),
        }  # fmt: skip
        return {name: ca.densify(value) for name, value in results.items()}

    return half("exact_back", s, formula, _sizes(system))


def _without_prior(system: Linear) -> ca.Function:
    """The last state by the equations alone, and 1 if these do not determine the first."""

    def judged(A: ca.SX, zeta: ca.SX, N: ca.SX) -> Results:
        sign = ca.diag(ca.if_else(ca.diag(A) < 0, -1, 1))
        sizes = ca.vertcat(*(ca.norm_2(row) for row in ca.vertsplit(A)))
        weak = ca.mmax(ca.fabs(ca.diag(A)) <= DEFICIENT * ca.fmax(sizes, DEFICIENT))
        right = ca.densify(sign @ ca.horzcat(zeta, N))
        return {"L": ca.densify((sign @ A).T), "right": right, "deficient": weak}

    judge = leaf("exact_start", {**_sizes(system), "deficient": 1}, judged)

    def formula(
        A: Term, N: Term, zeta: Term, B: Term, M: Term, b: Term, redundant: Term
    ) -> Results:
        del redundant
        L, right, deficient = judge(A, zeta, N)
        first = solve_upper_semidefinite(L, right)
        noise = ca.densify(matrix_product(B, ca.densify(first[:, 1:])) + M)
        P = times_transposed(noise, noise)
        x = matrix_product(B, first[:, 0]) + b
        return {"x_end": x, "P_end": P, "deficient": deficient}

    return half("exact_without_prior", system.s, formula, _sizes(system))


def _with_prior(system: Linear) -> ca.Function:
    """The last state by the equations and a prior of the first: ``(*carry, x, P) -> (x, P)``."""
    nx = system.s.model.nx

    def formula(
        A: Term, N: Term, zeta: Term, B: Term, M: Term, b: Term, redundant: Term, x: Term, P: Term
    ) -> Results:
        del redundant
        L = ca.densify(cholesky(P))
        rows = [
            ca.horzcat(matrix_product(A, L), -N),
            ca.horzcat(matrix_product(B, L), M),
        ]
        both = compress_rows(on_top([ca.densify(row) for row in rows]))
        fixed = known_by(
            both[:nx, :nx], zeta - matrix_product(A, x), NOTHING * (1 + ca.norm_inf(x))
        )
        x_end = matrix_product(B, x) + b + matrix_product(both[nx:, :nx], fixed)
        left = ca.densify(both[nx:, nx:])
        return {"x_end": x_end, "P_end": times_transposed(left, left)}

    return half("exact_with_prior", system.s, formula, _sizes(system))

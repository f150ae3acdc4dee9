r"""The iterated measurement update where sensors have no noise.

The cost of `backsight.estimators.kalman.iekf.IEKF` has :math:`R^{-1}`. With
:math:`x = \hat x^- + L z` and R = N N' it is that of a problem with equations,

.. math:: \min_{z, n} \tfrac12 (z'z + n'n) \quad \text{so that} \quad
    y - h(\hat x^- + L z) = N n,

in which N may be singular. A step of Gauss and Newton is the one of least size that obeys the
linearised equations,

.. math:: \begin{bmatrix} z \\ n \end{bmatrix} = M' \lambda, \quad M M' \lambda
    = y - h(x_i) + H_i L z_i, \quad M = \begin{bmatrix} H_i L & N \end{bmatrix},

the step of `IEKF` if N is regular. Steps are judged by the exact penalty function, the cost plus
:math:`\mu` times the sum of the absolute violations, :math:`\mu > \max |\lambda|`.

Source: Han, "A globally convergent method for nonlinear programming", Journal of Optimization
Theory and Applications 22 (1977), doi:10.1007/BF00932858; Nocedal and Wright, "Numerical
Optimization", 2006, doi:10.1007/978-0-387-40065-5, section 18.3.
"""

import dataclasses

import casadi as ca

from backsight.algebra.factor import cholesky_semidefinite
from backsight.algebra.update import masked
from backsight.engine.loops import iterate
from backsight.estimators.parts.covariance import (
    Covariance,
    Term,
    matrix_product,
    times_transposed,
    transposed,
)
from backsight.estimators.parts.factors import (
    Factor,
    compress_rows,
    on_top,
    solve_lower,
    solve_upper_semidefinite,
)
from backsight.estimators.parts.filtering import Halves
from backsight.estimators.parts.flags import Flags
from backsight.estimators.parts.leaf import Results, half, leaf, named_results, notation
from backsight.estimators.parts.substeps import within_bounds
from backsight.estimators.scaled import Setting

ROUNDING = 1e-12
"""By how much, relatively, the penalty function may be higher because of rounding."""


def iterated_exactly(s: Setting, halves: Halves, *, limit: int, tolerance: float) -> Halves:
    """`square_root_halves` of a setting with an iterated measurement update."""
    nx, ny = s.model.nx, s.model.ny
    once = halves.correct
    given = [ca.MX.sym(once.name_in(i), *once.size_in(i)) for i in range(once.n_in())]
    x, spread, *data = given
    begun = [ca.MX(0), ca.MX(1)]
    start = [ca.MX(1), ca.MX.zeros(nx), ca.MX.zeros(ny), ca.MX.zeros(nx), *begun]
    go, z, _, z_last, *_ = iterate(_step(s, tolerance), limit, carry=start, constants=given)
    # The covariance as the EKF has it that linearises where the last step began.
    moved = _moved(s)
    _, spread_post, flags = once(moved(x, spread, z_last), spread, *data)
    x_post, raised = _finished(s, tolerance)(moved(x, spread, z), go, flags)
    correct = ca.Function("iterated_exactly", given, [x_post, spread_post, raised])
    return dataclasses.replace(halves, correct=correct, iterated=True)


def _step(s: Setting, tolerance: float) -> ca.Function:
    """One step, ``(go, z, n, z_last, begun, t, ...) -> (go, z, n, z_last, begun, t)``.

    t is the share of the step that is tried, z_last is where the step to z began.
    """
    nx, ny, kept = s.model.nx, s.model.ny, Factor(Covariance(s.model.nx))
    measure, judge = _measurement(s), _judge(s, tolerance)

    def formula(
        go: Term, z: Term, n: Term, z_last: Term, begun: Term, t: Term,
        x: Term, spread: Term, u: Term, y: Term, mask: Term,
    ) -> Results:  # fmt: skip
        # 1. The step of least size that obeys the equations as they are at x_i.
        L = kept.opened(spread)
        H, e, noise, _ = measure(x + matrix_product(L, z), u, y, mask)
        HL = transposed(times_transposed(transposed(L), H))
        M = ca.densify(ca.horzcat(HL, noise))
        joint = compress_rows(on_top([M, type(M)(ca.DM.eye(nx + ny))]))
        root, onto = joint[:ny, :ny], joint[ny:, :ny]  # M = root onto', with orthogonal columns
        white = solve_lower(root, e + matrix_product(HL, z))
        multipliers = solve_upper_semidefinite(root, white)
        both = matrix_product(onto, white)  # M' multipliers, without squaring what is ill-posed
        z_next, n_next = both[:nx], both[nx:]

        # 2. Take it if it is the first, or does not raise the penalty function; else halve it.
        z_try, n_try = z + t * (z_next - z), n + t * (n_next - n)
        _, e_try, _, size = measure(x + matrix_product(L, z_try), u, y, mask)
        violated = e - matrix_product(noise, n)
        violated_try = e_try - matrix_product(noise, n_try)
        found = named_results(
            judge, go, z, n, z_last, begun, t, z_next, z_try, n_try, multipliers,
            violated, violated_try, size,
        )  # fmt: skip
        return {f"{name}_after": value for name, value in found.items()}

    sizes = {"spread": kept.size, "go": 1, "z": nx, "n": ny, "begun": 1, "t": 1}
    return half("exact_step", s, formula, sizes)


def _judge(s: Setting, tolerance: float) -> ca.Function:
    """Take a step, or halve it; see `_step`."""

    def formula(
        go: ca.SX, z: ca.SX, n: ca.SX, z_last: ca.SX, begun: ca.SX, t: ca.SX, z_next: ca.SX,
        z_try: ca.SX, n_try: ca.SX, multipliers: ca.SX, violated: ca.SX, violated_try: ca.SX,
        size: ca.SX,
    ) -> Results:  # fmt: skip
        weight = 2 * ca.norm_inf(multipliers)
        now = (ca.sumsqr(z) + ca.sumsqr(n)) / 2 + weight * ca.norm_1(violated)
        then = (ca.sumsqr(z_try) + ca.sumsqr(n_try)) / 2 + weight * ca.norm_1(violated_try)
        # The last step is shorter than what the cost resolves, as in `IEKF`.
        more = ca.norm_2(z_next - z) > tolerance
        better = then <= now + ROUNDING * (now + weight * size)
        good = ca.logic_or(ca.logic_or(begun < 1, better), ca.logic_not(more))
        return {
            "go": more if tolerance > 0 else go,
            "z": ca.if_else(good, z_try, z),
            "n": ca.if_else(good, n_try, n),
            "z_last": ca.if_else(good, z, z_last),
            "begun": ca.SX(1),
            "t": ca.if_else(good, 1, t / 2),
        }

    nx, ny = s.model.nx, s.model.ny
    sizes = {
        "go": 1, "z": nx, "n": ny, "begun": 1, "t": 1, "multipliers": ny, "violated": ny, "size": 1,
    }  # fmt: skip
    return leaf("judge_exactly", sizes, formula)


def _measurement(s: Setting) -> ca.Function:
    """Jacobian, residual, factor of the noise and size: ``(x, u, y, mask) -> (H, e, N, size)``."""

    def formula(x: ca.SX, u: ca.SX, y: ca.SX, mask: ca.SX) -> Results:
        y_hat = s.model.output(x, u)
        H, e, R = masked(ca.jacobian(y_hat, x), y - y_hat, ca.SX(s.R), mask)
        size = ca.dot(mask, ca.fabs(y) + ca.fabs(y_hat))
        noise = ca.densify(cholesky_semidefinite(R))
        return {"H": ca.densify(H), "e": e, "noise": noise, "size": size}

    return leaf("exact_measurement", notation(s), formula)


def _moved(s: Setting) -> ca.Function:
    """``(x_prior, spread, z) -> x_prior + L z``."""
    kept = Factor(Covariance(s.model.nx))

    def formula(x: Term, spread: Term, z: Term) -> Results:
        return {"x_moved": x + matrix_product(kept.opened(spread), z)}

    return half("moved_by_factor", s, formula, {"spread": kept.size, "z": s.model.nx})


def _finished(s: Setting, tolerance: float) -> ca.Function:
    """Keep the bounds and say what happened: ``(x, go, flags) -> (x, flags)``."""

    def formula(x: ca.SX, go: ca.SX, flags: ca.SX) -> Results:
        inside = within_bounds(s, x)
        raised = dataclasses.replace(
            Flags.of(flags),
            clipped=ca.if_else(ca.norm_1(inside - x) > 0, 1, 0),
            iteration_limit=go if tolerance > 0 else 0,
        )
        return {"x_inside": inside, "flags": raised.vector()}

    return leaf("finished_exactly", {**notation(s), "go": 1}, formula)

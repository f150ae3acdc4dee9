r"""One sample of the joint input and state filter with sensors that have no noise.

Their information is without limit, of which there is no matrix. So nothing is inverted: with the
factor L of the covariance of the state, N of that of the sensors and noises
:math:`\varepsilon \sim N(0, I)`, a sample reads

.. math:: e = H d + [C L, N]\,\varepsilon, \qquad x = \hat x^- + G d + [L, 0]\,\varepsilon .

1. An orthogonal transformation of the rows makes those of H triangular: as many rows as there are
   forces say what d is, :math:`d = R_H^{-1} (e_1 - Y_1 \varepsilon)`, and the others have no d.
2. The others fix as many combinations of the noises. A row of which nothing is left beside those
   above it tells what was known exactly; it is left out, and the status says *redundant*.
3. What is left of the noises in x and d is the factor of their covariance.

A force that the measured rows do not determine has a prior, which is a row more for each. For
sensors that all have noise it is the filter of `_step`, at several times its cost.

Source: the filter is that of Gillijns and De Moor (2007), doi:10.1016/j.automatica.2006.08.002 and
doi:10.1016/j.automatica.2006.11.016; the generalised least squares in each step: Paige, "Computer
solution and perturbation analysis of generalized linear least squares problems", Mathematics of
Computation 33 (1979), doi:10.1090/S0025-5718-1979-0514820-3.
"""

import casadi as ca
import numpy as np

from backsight.algebra.factor import cholesky_semidefinite
from backsight.algebra.triangular import (
    backward_semidefinite,
    fixed_directions,
    upper_triangular,
)
from backsight.algebra.update import masked, measured, noise_of
from backsight.discrete.steps import over_sample
from backsight.engine.dense import few_entries
from backsight.estimators.joint_input._extended import all_inputs, without_forces
from backsight.estimators.joint_input._step import lost_forces, tail
from backsight.estimators.joint_input._system import Forces, comparable
from backsight.estimators.kalman.exact_sensors import ROUNDING, exact_sensors
from backsight.estimators.parts.covariance import (
    Covariance,
    Term,
    matrix_product,
    times_transposed,
    transposed,
)
from backsight.estimators.parts.factors import Factor, compress_rows, on_top, with_fixed
from backsight.estimators.parts.flags import Flags
from backsight.estimators.parts.leaf import Results, half, leaf, named_results, notation
from backsight.estimators.parts.linear import root
from backsight.estimators.parts.substeps import within_bounds
from backsight.estimators.scaled import Setting
from backsight.types import Array


def spread_of_prior(s: Setting) -> Array:
    """The covariance of the prior as the filter keeps it: a factor if sensors have no noise."""
    kept = Covariance(s.model.nx)
    return Factor(kept).spread(s.P0) if exact_sensors(s) else kept.kept(s.P0)


def exact_step(found: Forces) -> ca.Function:
    """The results of `_step.step`; P is the factor of the covariance as `Factor` keeps it."""
    system, s, m = found.system, found.system.s, len(found.names)
    nx, ny, nu = s.model.nx, s.model.ny, found.nu
    A, C, E = few_entries(system.A), ca.DM(system.C), ca.DM(found.E)
    B, ramp, D = (few_entries(k[:, :nu]) for k in (system.B, system.B_next, system.D))

    def seen(x: Term, started: Term, u: Term, y: Term) -> Results:
        prior = x + started * matrix_product(ramp, u)
        missed = y - matrix_product(C, prior) - matrix_product(D, u)
        return {"prior": prior, "missed": missed}

    def ahead(x: Term, d: Term, u: Term) -> Results:
        x_next = matrix_product(A, x) + matrix_product(B, u)
        return {"x_next": x_next + matrix_product(E, d) if found.direct else x_next}

    sizes = {"started": 1, "u": nu, "d": m}
    to_prior, go = half("joint_prior", s, seen, sizes), half("joint_ahead", s, ahead, sizes)
    x, P = ca.MX.sym("x", nx), ca.MX.sym("P", Factor(Covariance(nx)).size)
    started = ca.MX.sym("started")
    u_given, y_given, mask = (
        ca.MX.sym(k, n) for k, n in (("u", nu), ("y", ny), ("mask", ny))
    )  # fmt: skip
    u, y = u_given / ca.DM(s.su[:nu]), y_given / ca.DM(s.sy)
    prior, missed = to_prior(x, started, u, y)
    acted = ca.MX(1) if found.direct else started
    moved = ca.MX.zeros(nx, m) if found.direct else started * ca.MX(ca.densify(E))
    known = named_results(
        _corrected(found), P, prior, ca.MX(ca.densify(C)), ca.MX(ca.DM(found.H)), moved, missed,
        acted, mask,
    )  # fmt: skip
    v = all_inputs(found)(u_given, known["d"])
    transition = ca.MX(ca.densify(ca.DM(system.A))), ca.MX(ca.densify(E))
    results = _finished(found, known, v) | {
        "x_next": go(known["x_post"], known["d"], u),
        "P_next": _ahead(found)(known["J"], *transition),
        "prior": prior,
    }
    return ca.Function(
        "joint_input_exactly",
        [x, P, started, u_given, y_given, mask],
        list(results.values()),
        ["x", "P", "started", "u", "y", "mask"],
        list(results),
    )


def exact_extended_step(found: Forces) -> ca.Function:
    """The results of `_extended.extended_step`; P as in `exact_step`."""
    s, m = found.system.s, len(found.names)
    nx, ny, nu = s.model.nx, s.model.ny, found.nu
    x, P = ca.MX.sym("x", nx), ca.MX.sym("P", Factor(Covariance(nx)).size)
    E, started = ca.MX.sym("E", nx, m), ca.MX.sym("started")
    u, y, mask = ca.MX.sym("u", nu), ca.MX.sym("y", ny), ca.MX.sym("mask", ny)
    C, F, missed = without_forces(found)(x, u, y)
    acted = ca.MX(1) if found.direct else started
    shown = F if found.direct else matrix_product(C, E)
    moved = ca.MX.zeros(nx, m) if found.direct else started * E
    known = named_results(_corrected(found), P, x, C, shown, moved, missed, acted, mask)
    inputs = all_inputs(found)
    acting = inputs(u, known["d"] if found.direct else ca.MX.zeros(m))
    over = over_sample(s.integrator, s.model, s.dt)
    x_next, A, B = over(known["x_post"], acting, acting)
    E_next = B[:, nu:] * ca.repmat(ca.MX(ca.DM(found.unit / s.su[nu:])).T, nx, 1)
    results = _finished(found, known, inputs(u, known["d"])) | {
        "x_next": x_next,
        "P_next": _ahead(found)(known["J"], A, E_next),
        "E_next": E_next,
    }
    return ca.Function(
        "joint_input_extended_exactly",
        [x, P, E, started, u, y, mask],
        list(results.values()),
        ["x", "P", "E", "started", "u", "y", "mask"],
        list(results),
    )


def _finished(found: Forces, known: dict[str, Term], v: Term) -> dict[str, Term]:
    """What both steps put out of a corrected sample."""
    joint = _product(found)(known["J"])
    triangle, d_triangle = tail(found)(joint)
    return {
        "x_post": known["x_post"],
        "d": known["d"] * ca.DM(found.unit),
        "d_scaled": known["d"],
        "joint": joint,
        "J": known["J"],
        "triangle": triangle,
        "d_triangle": d_triangle,
        "v": v,
        "e": known["e"],
        "spread": known["S"],
        "flags": known["flags"],
    }


def _corrected(found: Forces) -> ca.Function:
    """States and forces given a sample, and the factor J (nx + m, nx + m) of their covariance.

    ``(P, x, C, shown, moved, missed, acted, mask)``, with x and the innovation `missed` without
    the forces, which are `shown` by the outputs and have `moved` the state, if one has `acted`.
    """
    s, m = found.system.s, len(found.names)
    nx, ny, kept = s.model.nx, s.model.ny, Factor(Covariance(s.model.nx))
    rows, settle = _rows(found), _settled(found)

    def formula(
        factor: Term, x: Term, C: Term, shown: Term, moved: Term, missed: Term, acted: Term,
        mask: Term,
    ) -> Results:  # fmt: skip
        L = kept.opened(factor)
        CL = transposed(times_transposed(transposed(L), C))
        told = named_results(rows, CL, C, x, shown, missed, acted, mask)
        D, V, d = told["D"], told["V"], told["d_0"]
        # 3. State and force by the noises, of which some are fixed.
        of_x = ca.horzcat(L, type(L).zeros(nx, ny + m)) + matrix_product(moved, D)
        both, mean = on_top([ca.densify(of_x), D]), ca.vertcat(x + matrix_product(moved, d), d)
        both, mean = with_fixed(both, mean, V, told["fixed"])
        x_post, flags = settle(mean[:nx], told["lost"] * acted, told["redundant"])
        return {
            "x_post": x_post,
            "d": mean[nx:],
            "J": compress_rows(ca.densify(both)),
            "e": told["e"],
            "S": times_transposed(CL, CL) + told["noise"],
            "flags": flags,
        }

    sizes = {"factor": kept.size, "C": (ny, nx), "shown": (ny, m), "moved": (nx, m), "missed": ny,
             "acted": 1, "d": m}  # fmt: skip
    return half("joint_corrected_exactly", s, formula, sizes)


def _rows(found: Forces) -> ca.Function:
    """The rows of a sample, solved for forces and for noises.

    ``(C L, C, x, shown, missed, acted, mask)`` to forces ``d_0 + D epsilon``, directions of the
    noises as rows of V and what they are ``fixed`` to, whether the forces are ``lost`` and a
    sensor ``redundant``, the innovation, and its noise.
    """
    s, m = found.system.s, len(found.names)
    nx, ny = s.model.nx, s.model.ny
    of_prior, sigma = np.linalg.inv(np.linalg.cholesky(found.spread)), np.sqrt(np.diag(s.R))
    weights, complete = comparable(found)

    def formula(
        CL: ca.SX, C: ca.SX, x: ca.SX, shown: ca.SX, missed: ca.SX, acted: ca.SX, mask: ca.SX
    ) -> Results:
        # One size for all rows, so that a number says what is rounding.
        seen = measured(mask)
        size = ca.fabs(C) @ ca.fmax(ca.fabs(x), 1) + sigma
        unit = 1 / ca.if_else(size > 0, size, 1)
        weigh = ca.diag(mask * unit)
        _, _, R = masked(C, missed, ca.SX(s.R), mask)
        N = ca.diag(ca.if_else(seen, unit, 1)) @ cholesky_semidefinite(R)
        of_noise = ca.vertcat(
            ca.horzcat(weigh @ CL, N, ca.SX.zeros(ny, m)),
            ca.horzcat(ca.SX.zeros(m, nx + ny), ca.SX.eye(m)),
        )
        lost = lost_forces(acted * ca.diag(seen) @ (weights * shown), complete)
        of_d = ca.vertcat(acted * weigh @ shown, lost * ca.SX(of_prior))
        right = ca.vertcat(weigh @ missed, ca.SX.zeros(m))
        # 1. Forces out of as many rows as there are readings.
        turned = upper_triangular(of_d, ca.horzcat(of_d, of_noise, right))
        positive = ca.diag(ca.if_else(ca.diag(turned[:m, :m]) < 0, -1, 1)) @ turned[:m, :]
        told = backward_semidefinite(positive[:, :m].T, positive[:, m:])
        # 2. What the others fix.
        V, fixed, follows = fixed_directions(turned[m:, m:-1], turned[m:, -1], least=ROUNDING)
        return {
            "d_0": told[:, -1],
            "D": ca.densify(-told[:, :-1]),
            "V": V,
            "fixed": fixed,
            "lost": lost,
            "redundant": follows > 0,
            "e": seen * missed,
            "noise": ca.densify(noise_of(ca.SX(s.R), mask)),
        }

    sizes = {
        **notation(s), "CL": (ny, nx), "C": (ny, nx), "shown": (ny, m), "missed": ny, "acted": 1,
        "noise": (ny, ny), "d": m, "lost": 1,
    }  # fmt: skip
    return leaf("joint_rows_exactly", sizes, formula)


def _settled(found: Forces) -> ca.Function:
    """State within its bounds, and flags: ``(x, unobserved, redundant)``."""
    s = found.system.s

    def formula(x: ca.SX, unobserved: ca.SX, redundant: ca.SX) -> Results:
        inside = within_bounds(s, x)
        clipped = ca.if_else(ca.norm_1(inside - x) > 0, 1, 0)
        flags = Flags(clipped=clipped, unobserved=unobserved, redundant=redundant)
        return {"x_in": inside, "flags": flags.vector()}

    return leaf("joint_settled", {**notation(s), "unobserved": 1, "redundant": 1}, formula)


def _product(found: Forces) -> ca.Function:
    """Factor J of states and forces to their covariance."""
    n = found.system.s.model.nx + len(found.names)

    def formula(J: Term) -> Results:
        return {"joint": ca.densify(times_transposed(J, J))}

    return half("joint_product", found.system.s, formula, {"J": (n, n)})


def _ahead(found: Forces) -> ca.Function:
    """``(J, A, E)`` to the factor of the covariance of the states ahead, as it is kept."""
    s, m = found.system.s, len(found.names)
    nx, kept, G = s.model.nx, Factor(Covariance(s.model.nx)), root(s.Q)

    def formula(J: Term, A: Term, E: Term) -> Results:
        by = ca.horzcat(A, E if found.direct else 0 * E)
        moved = matrix_product(ca.densify(by), J)
        L = compress_rows(ca.densify(ca.horzcat(moved, type(J)(ca.DM(G)))))
        return {"factor": ca.vertcat(kept.closed(L), 0)}

    sizes = {"J": (nx + m, nx + m), "A": (nx, nx), "E": (nx, m)}
    return half("joint_factor_ahead", s, formula, sizes)

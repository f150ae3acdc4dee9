"""The joint input and state filter of nonlinear models: linearised at every estimate.

The same filter with the matrices of the extended Kalman filter: outputs are linearised at the
prior, a sampling period at the estimate before it. So an unknown stiffness goes along as a state.
Source: Ghosh, Roy, Manohar, "New forms of extended Kalman filter via transversal linearization and
applications to structural system identification", 2007, doi:10.1016/j.cma.2007.05.004, for such
states; the filter as in `backsight.estimators.joint_input._step`.
"""

import dataclasses

import casadi as ca
import numpy as np

from backsight.algebra.symmetric import vech
from backsight.algebra.update import measured, noise_of
from backsight.discrete.steps import over_sample
from backsight.errors import TuningError
from backsight.estimators.joint_input._step import corrected, settled_forces, tail
from backsight.estimators.joint_input._system import Forces
from backsight.estimators.parts.covariance import Term, congruence, symmetric_part, times_transposed
from backsight.estimators.parts.leaf import Results, half, leaf, named_results, notation
from backsight.estimators.parts.linear import Linear
from backsight.estimators.scaled import Setting


def at_prior(s: Setting) -> Linear:
    """The system at the prior's mean without inputs, for judging whether forces can be found."""
    x0, still = s.x0, np.zeros(s.model.nu)
    _, A, B = (np.asarray(k) for k in over_sample(s.integrator, s.model, s.dt)(x0, still, still))
    x, u = ca.SX.sym("x", s.model.nx), ca.SX.sym("u", s.model.nu)
    y = s.model.output(x, u)
    slopes = ca.Function("slopes", [x, u], [ca.densify(ca.jacobian(y, k)) for k in (x, u)])
    C, D = (np.asarray(k) for k in slopes(x0, still))
    if not all(np.isfinite(k).all() for k in (A, B, C, D)):
        raise TuningError("the model has no finite derivative at the mean of the prior; move x0")
    kept = dataclasses.replace(s, Q=s.sampled().Q, Qc=np.zeros_like(s.Qc))
    return Linear(kept, A, B, np.zeros_like(B), C, D, ramp=False)


def extended_step(found: Forces) -> ca.Function:
    """Correct with a sample's data and predict: ``(x, P, E, started, u, y, mask)``.

    E says how the forces of the period before have moved x, which was predicted without them; not
    used if the outputs contain the forces of their own sample. To what `_step.step` gives, and
    ``E_next``.
    """
    s = found.system.s
    nx, ny, nu, m = s.model.nx, s.model.ny, found.nu, len(found.names)
    seen, gains = without_forces(found), _gains(found)
    over = over_sample(s.integrator, s.model, s.dt)
    inputs = all_inputs(found)

    def ahead(joint: Term, A: Term, E: Term) -> Results:
        by = ca.horzcat(A, E if found.direct else 0 * E)
        return {"P_next": congruence(by, joint, ca.DM(s.Q))}

    sizes = {"joint": (nx + m, nx + m), "A": (nx, nx), "E": (nx, m)}
    go_on = half("joint_input_ahead", s, ahead, sizes)

    def both(P: Term, T: Term, V: Term) -> Results:
        return {"joint": ca.densify(symmetric_part(congruence(T, P, V)))}

    together = half("joint_input_both", s, both, {"T": (nx + m, nx), "V": (nx + m, nx + m)})

    def shown(P: Term, C: Term) -> Results:
        return {"PCt": ca.densify(times_transposed(P, C))}

    with_outputs = half("joint_input_seen", s, shown, {"C": (ny, nx), "PCt": (nx, ny)})

    x, P = ca.MX.sym("x", nx), ca.MX.sym("P", with_outputs.size1_in(0))
    E, started = ca.MX.sym("E", nx, m), ca.MX.sym("started")
    u, y, mask = ca.MX.sym("u", nu), ca.MX.sym("y", ny), ca.MX.sym("mask", ny)
    C, F, missed = seen(x, u, y)
    PCt = with_outputs(P, C)
    known = named_results(gains, x, C, F, E, PCt, started, missed, mask)
    joint = together(P, known["T"], known["V"])
    v = inputs(u, known["d_scaled"])
    moved = inputs(u, known["d_scaled"] if found.direct else ca.MX.zeros(m))
    x_next, A, B = over(known["x_post"], moved, moved)
    E_next = B[:, nu:] * ca.repmat(ca.MX(ca.DM(found.unit / s.su[nu:])).T, nx, 1)
    triangle, d_triangle = tail(found)(joint)
    results = {
        "x_next": x_next,
        "P_next": go_on(joint, A, E_next),
        "E_next": E_next,
        "triangle": triangle,
        "d_triangle": d_triangle,
        "joint": ca.densify(joint),
        "v": v,
        **{k: known[k] for k in ("x_post", "e", "spread", "flags", "d")},
    }
    return ca.Function(
        "joint_input_extended",
        [x, P, E, started, u, y, mask],
        list(results.values()),
        ["x", "P", "E", "started", "u", "y", "mask"],
        list(results),
    )


def all_inputs(found: Forces) -> ca.Function:
    """``(u, d) -> v``: all inputs of the model, scaled."""
    s, nu = found.system.s, found.nu
    u, d = ca.SX.sym("u", nu), ca.SX.sym("d", len(found.names))
    v = ca.vertcat(u / s.su[:nu], d * (found.unit / s.su[nu:]))
    return ca.Function("all_inputs", [u, d], [v])


def without_forces(found: Forces) -> ca.Function:
    """``(x, u, y) -> (C, F, e)``: outputs at the prior without forces, and their derivatives."""
    s, nu, m = found.system.s, found.nu, len(found.names)

    def formula(x: ca.SX, u: ca.SX, y: ca.SX) -> Results:
        d = ca.SX.sym("d", m)
        expected = s.model.output(x, all_inputs(found)(u, d))
        slopes = [ca.jacobian(expected, x), ca.jacobian(expected, d), expected]
        C, F, y_prior = (ca.densify(ca.substitute(k, d, ca.SX.zeros(m))) for k in slopes)
        return {"C": C, "F": F, "missed": y / s.sy - y_prior}

    sizes = {**notation(s), "u": nu, "F": (s.model.ny, m)}
    return leaf("joint_input_look", sizes, formula)


def _gains(found: Forces) -> ca.Function:
    """Everything but products with P and the way to the next sample, see `_step.corrected`."""
    s, m = found.system.s, len(found.names)
    nx, ny = s.model.nx, s.model.ny

    def formula(
        x: ca.SX, C: ca.SX, F: ca.SX, E: ca.SX, PCt: ca.SX, started: ca.SX, missed: ca.SX,
        mask: ca.SX,
    ) -> Results:  # fmt: skip
        acted = ca.SX(1) if found.direct else started
        H = F if found.direct else C @ E
        G = ca.SX.zeros(nx, m) if found.direct else started * E
        now = corrected(found, PCt, C=C, H=H, G=G, acted=acted, missed=missed, mask=mask)
        free = x + now["L"] @ now["innovation"]
        x_post, flags = settled_forces(found, free, now["lost"] * acted)
        return {
            "x_post": x_post,
            "d": now["d"] * ca.SX(found.unit),
            "d_scaled": now["d"],
            "e": measured(mask) * missed,
            "spread": vech(ca.densify(C @ PCt + noise_of(ca.SX(s.R), mask))),
            "flags": flags,
            "T": now["T"],
            "V": now["V"],
        }

    sizes = {
        **notation(s), "C": (ny, nx), "F": (ny, m), "E": (nx, m), "PCt": (nx, ny), "started": 1,
        "missed": ny,
    }  # fmt: skip
    return leaf("joint_input_extended_gains", sizes, formula)

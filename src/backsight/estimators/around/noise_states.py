r"""Noise that is not additive, or in two places at once, as states of the model.

Additive noise that is independent of all else is what every method takes. All other white noise
:math:`\omega_k`, with a new value in every sample, becomes states that forget:

.. math::
    x_{k+1} = f(x_k, u_k, \omega_k) + w_k, \qquad \omega_{k+1} = 0 + w^\omega_k, \qquad
    y_k = h(x_k, u_k, \omega_k) + v_k

Its derivatives with respect to :math:`\omega` then enter process and measurement, and the
covariance between the two is exact: an extended Kalman filter has
:math:`Q + L W L'`, :math:`R + M W M'` and the cross term :math:`L W M'` with
:math:`L = \partial f / \partial \omega` and :math:`M = \partial h / \partial \omega`, an unscented
one the sigma points of the noise, a window estimates the noise itself.

References
----------
Simon, "Optimal State Estimation", 2006, doi:10.1002/0470045345, sections 7.1 and 13.2.
"""

import dataclasses

import casadi as ca
import numpy as np
import scipy

from backsight.algebra.symmetric import unvech, vech
from backsight.discrete.exact import zoh
from backsight.discrete.noise import discretise_noise
from backsight.discrete.runge_kutta import Integrator
from backsight.engine.recursion import Channel, Recursion
from backsight.errors import TuningError
from backsight.estimators.uncertainty import Noise, Prior, covariance_faults
from backsight.models.lti import state_equation, state_space
from backsight.models.model import Model
from backsight.models.signals import Signal, along
from backsight.models.structures import forces_as_inputs
from backsight.schema import Status
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class Widened:
    """A discrete-time model with noise states behind its own, its noise and prior."""

    model: Model
    noise: Noise
    prior: Prior


def widened(
    noise: Noise,
    prior: Prior,
    model: Model,
    dt: float,
    *,
    integrator: Integrator | None,
    remembered: bool = False,
) -> Widened:
    """Make states of the noise of inputs and parameters, and of what w and v have in common.

    A continuous-time model is carried to discrete time with its inputs held.

    Parameters
    ----------
    noise, prior, model, dt
        As for an estimator.
    integrator : Integrator or None
        For continuous models, with nothing left open; None discretises a linear one exactly.
    remembered : bool
        The noise of inputs that states multiply is a state for one sample more, for filters, which
        linearise there; see `backsight.estimators.parts.filtering.noise_to_look_back_at`.

    Raises
    ------
    TuningError, ModelError
        If the description does not fit the model.
    """
    inputs, parameters = noise.of_inputs(model), noise.of_parameters(model)
    common = _common(noise, model)
    own = _own_noise(model, prior, dt)
    pick_u = np.eye(model.nu)[:, inputs > 0]
    pick_p = np.eye(len(model.parameters))[:, parameters > 0]
    W = scipy.linalg.block_diag(
        np.diag(inputs[inputs > 0] ** 2), np.diag(parameters[parameters > 0] ** 2), common.W
    )

    # State and output equation with the noise where it acts.
    nx, n_u, n_p = model.nx, pick_u.shape[1], pick_p.shape[1]
    x, of_u = ca.SX.sym("x", nx), ca.SX.sym("of_u", n_u)
    of_p, shared = ca.SX.sym("of_p", n_p), ca.SX.sym("shared", len(common.W))
    u, p = ca.SX.sym("u", model.nu), ca.SX.sym("p", len(model.parameters))
    felt = [x, u + ca.mtimes(pick_u, of_u), p + ca.mtimes(pick_p, of_p)]
    moved = _from_sample_to_sample(model, dt, pick_p, integrator).call(felt)[0]
    moved += ca.mtimes(common.to_x, shared)
    seen = model.h.call(felt)[0] + ca.mtimes(common.to_y, shared)
    forgotten, last = ca.SX.zeros(len(W)), ca.SX.zeros(0)
    bent = ca.which_depends(ca.vertcat(moved, seen), ca.vertcat(x, of_u), 2, True)
    if remembered and any(bent):
        last = of_u
    z = ca.vertcat(x, of_u, of_p, shared, ca.SX.sym("last", last.numel()))
    # The step of a sample, as the rate that virtual outputs of a continuous model know.
    w = ca.SX.sym("w", z.numel())
    step = w[:nx] + ca.mtimes(common.to_x, shared)
    names = [s.name for s, v in zip(model.inputs, inputs, strict=True) if v > 0]
    names += [s.name for s, v in zip(model.parameters, parameters, strict=True) if v > 0]
    names += [f"common{i + 1}" for i in range(len(common.W))]
    names += [f"{name}_last" for name in names[: last.numel()]]
    still = np.zeros((last.numel(), last.numel()))
    wide = dataclasses.replace(
        model,
        f=ca.Function("f", [z, u, p], [ca.vertcat(moved, forgotten, last)]),
        h=ca.Function("h", [z, u, p], [seen]),
        states=(*model.states, *(Signal(name=_unused(n, model)) for n in names)),
        # The rounding of readings is in R already.
        outputs=tuple(dataclasses.replace(s, resolution=None) for s in model.outputs),
        dt=dt if model.continuous else model.dt,
        driven=(),  # what it adds is in Q
        unsolved=model.unsolved_at([z, u, p], felt),
        virtual=along(
            model.virtual, [z, u, p, w], [*felt, step / dt if model.continuous else step]
        ),
    )
    return Widened(
        wide,
        Noise(R=common.R, Q=scipy.linalg.block_diag(common.Q + own, W, still)),
        Prior(
            x0=np.concatenate([prior.mean(model), np.zeros(len(W) + len(still))]),
            P0=scipy.linalg.block_diag(prior.covariance(model), W, still),
        ),
    )


def _own_noise(model: Model, prior: Prior, dt: float) -> Array:
    """What the model's own noise adds per sample; at the prior's mean if it is not linear."""
    own = model.noise_of_its_own()
    if not (model.continuous and own.any()):
        return own
    x, u = ca.SX.sym("x", model.nx), ca.SX.sym("u", model.nu)
    slope = ca.densify(ca.jacobian(model.rhs(x, u), x))
    A = np.array(ca.Function("A", [x, u], [slope])(prior.mean(model), np.zeros(model.nu)))
    return discretise_noise(np.where(np.isfinite(A), A, 0.0), own, dt=dt)[1]


def linear_in_noise(noise: Noise, model: Model) -> bool:
    """Whether the parameters that are noise enter the rates like inputs of a linear model."""
    return state_equation(_with_noise_as_inputs(model, noise.of_parameters(model))) is not None


def without_noise_states(plain: Recursion, nx: int, *, raised: Status) -> Recursion:
    """Put out only the first nx states, and their covariances; add bits to the status."""
    sizes = (len(plain.carry0), *plain.input_sizes)
    data = [ca.MX.sym(f"d{i}", size) for i, size in enumerate(sizes)]
    carry, *values = plain.step.call(data, True, False)
    cut = [
        _of_states(c, value, nx) + (int(raised) if c.name == "status" else 0)
        for c, value in zip(plain.channels, values, strict=True)
    ]
    step = ca.Function(plain.name, data, [carry, *cut])
    return dataclasses.replace(plain, step=step, start=None)


def _of_states(channel: Channel, value: ca.MX, nx: int) -> ca.MX:
    if "state_" in channel.dims:
        return _first(nx, value)
    return value[:nx] if "state" in channel.dims else value


def _first(nx: int, triangle: ca.MX) -> ca.MX:
    """Lower triangle of the first block of a symmetric matrix."""
    P = ca.SX.sym("P", triangle.numel())
    block = vech(ca.densify(unvech(P)[:nx, :nx]))
    return ca.Function(f"first_{nx}", [P], [block])(triangle)


def _unused(name: str, model: Model) -> str:
    known, new = {s.name for s in model.signals}, f"{name}_noise"
    while new in known:
        new += "_"
    return new


def _from_sample_to_sample(
    model: Model, dt: float, pick_p: Array, integrator: Integrator | None
) -> ca.Function:
    """``(x, u, p) -> x`` over a sampling period with held inputs."""
    if not model.continuous:
        return model.f
    x, u = ca.SX.sym("x", model.nx), ca.SX.sym("u", model.nu)
    p = ca.SX.sym("p", len(model.parameters))
    if integrator is None or integrator.scheme == "exact":
        joined = _with_noise_as_inputs(model, pick_p.sum(axis=1))
        if (found := state_equation(joined)) is None:
            state_space(joined)  # says what is not linear
            raise TuningError(f"model '{model.name}' is not linear between samples")
        A, B, c = found
        # The constant is an input of one.
        Ad, Bd = zoh(A, np.hstack([B, c[:, None]]), dt=dt)
        forced = ca.vertcat(u, ca.mtimes(pick_p.T, p), 1)
        return ca.Function("f", [x, u, p], [ca.mtimes(Ad, x) + ca.mtimes(Bd, forced)])
    end, h = x, dt / integrator.steps
    for _ in range(integrator.steps):
        end = integrator.substep(lambda x, u: model.f.call([x, u, p])[0], end, ua=u, ub=u, h=h)
    return ca.Function("f", [x, u, p], [end])


def _with_noise_as_inputs(model: Model, sigma: Array) -> Model:
    """The model with the parameters that are noise, whose `sigma` is not 0, behind its inputs."""
    names = [s.name for s, size in zip(model.parameters, sigma, strict=True) if size > 0]
    return forces_as_inputs(model, names) if names else model


@dataclasses.dataclass(frozen=True)
class _Common:
    r"""Process and measurement noise as independent ones and what they have in common.

    .. math:: w = G c + w', \quad v = V c + v', \quad c \sim N(0, W)
    """

    W: Array
    to_x: Array
    to_y: Array
    Q: Array
    R: Array


def _common(noise: Noise, model: Model) -> _Common:
    """Split by what w tells of v: the covariance of E[v | w] is N' Q^+ N with N = E[w v']."""
    Q, R = noise.per_sample(model), noise.measurement(model, singular=True)
    nothing = _Common(np.zeros((0, 0)), np.zeros((model.nx, 0)), np.zeros((model.ny, 0)), Q, R)
    if noise.cross is None or not np.any(noise.cross):
        return nothing
    N = np.asarray(noise.cross, float)
    if N.shape != (model.nx, model.ny):
        raise TuningError(
            f"cross has the shape {N.shape}; it must be {(model.nx, model.ny)}: covariance of the "
            "process noise of every state with the noise of every output"
        )
    joint = np.block([[Q, N], [N.T, R]])
    for fault in covariance_faults(joint, what="[[Q, cross], [cross', R]]", singular=True):
        raise TuningError(fault)
    q, r = (np.sqrt(np.where(np.diag(k) > 0, np.diag(k), 1.0)) for k in (Q, R))
    unit_Q, unit_N = Q / np.outer(q, q), N / np.outer(q, r)
    values, V = np.linalg.eigh(unit_N.T @ np.linalg.pinv(unit_Q, hermitian=True) @ unit_N)
    keep = values > 1e-12 * values[-1]
    W, V = np.diag(values[keep]), V[:, keep]
    G = unit_N @ V / values[keep]
    rest, left = np.linalg.eigh(unit_Q - G @ W @ G.T)
    rest = left @ np.diag(np.maximum(rest, 0.0)) @ left.T
    own = R - np.outer(r, r) * (V @ W @ V.T)
    exact = any(covariance_faults(R, what="R", singular=False))
    if not exact and any(covariance_faults(own / np.outer(r, r), what="R", singular=False)):
        raise TuningError(
            "R - cross' Q^+ cross is singular: the process noise says all of the measurement "
            "noise, which then is none of its own; make R larger than what they have in common"
        )
    return _Common(W, q[:, None] * G, r[:, None] * V, np.outer(q, q) * rest, own)

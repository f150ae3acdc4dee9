"""A model with its noise and prior in scaled variables: what every method is built of."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import casadi as ca
import numpy as np

from backsight.algebra.newton import SOLVED
from backsight.algebra.symmetric import unvech, vech
from backsight.discrete.modes import modes_at, modes_over
from backsight.discrete.noise import integrated_noise
from backsight.discrete.runge_kutta import Integrator
from backsight.discrete.steps import complaint, settle_steps
from backsight.errors import BacksightError, TuningError
from backsight.estimators._sizes import WALK_SAMPLES, with_scales
from backsight.estimators.uncertainty import Noise, Prior
from backsight.estimators.varied_noise import ScaledPart, noise_at, scaled_parts
from backsight.models.model import Model
from backsight.models.views.scale import scale
from backsight.types import Array

EXACT = Integrator("exact", 1)
"""For discrete models, and linear ones that are made discrete."""


@dataclasses.dataclass(frozen=True)
class Setting:
    """A model with its noise and prior in scaled variables.

    Parameters
    ----------
    model : Model
        Scaled.
    dt : float
        Sampling period [s].
    x0, P0, Q, Qc, R : arrays
        Scaled; `Q` is added per sample, `Qc` is a spectral density, zero for discrete models.
    integrator : Integrator
        With nothing left open, see `backsight.discrete.steps.choose`.
    coarse : bool
        Whether it is too coarse for the model at the prior's mean.
    sx, su, sy : arrays
        Scales of states, inputs, outputs.
    parts : tuple of ScaledPart
        Process noise that inputs multiply, beside `Q` and `Qc`, and measurement noise.
    """

    model: Model
    dt: float
    x0: Array
    P0: Array
    Q: Array
    Qc: Array
    R: Array
    integrator: Integrator
    coarse: bool
    sx: Array
    su: Array
    sy: Array
    parts: tuple[ScaledPart, ...] = ()

    @property
    def lower(self) -> Array:
        """Lower bounds of the scaled states, (nx,)."""
        return np.array([s.lower for s in self.model.states])

    @property
    def upper(self) -> Array:
        """Upper bounds of the scaled states, (nx,)."""
        return np.array([s.upper for s in self.model.states])

    def enter(self) -> ca.Function:
        """Physical to scaled data: (u, y, mask) -> (u, y, mask).

        In parts, so that what depends on the inputs alone can be told from what the mask changes.
        """
        u, y, mask = data_symbols(self.model)
        scaled_u = ca.Function("enter_u", [u], [u / self.su])
        scaled_y = ca.Function("enter_y", [y], [y / self.sy])
        data = [ca.MX.sym(f"d{i}", k.numel()) for i, k in enumerate((u, y, mask))]
        results = [scaled_u(data[0]), scaled_y(data[1]), data[2]]
        return ca.Function("enter", data, results, {"always_inline": True})

    def sampled(self) -> Setting:
        """The same with all process noise as a covariance per sample.

        That of `Qc` is Van Loan's integral for the model linearised at the prior's mean; where it
        has no derivative there, ``Qc * dt``.
        """
        if not self.Qc.any() and not any(part.Qc.any() for part in self.parts):
            return self
        x, u = ca.SX.sym("x", self.model.nx), ca.SX.sym("u", self.model.nu)
        rates = ca.densify(ca.jacobian(self.model.rhs(x, u), x))
        A = np.array(ca.Function("A", [x, u], [rates])(self.x0, np.zeros(self.model.nu)))
        A = A if np.isfinite(A).all() else np.zeros_like(A)
        return self.with_noise(lambda Q, Qc: (Q + integrated_noise(A, Qc, dt=self.dt)[1], 0 * Qc))

    def with_noise(self, change: Callable[[Array, Array], tuple[Array, Array]]) -> Setting:
        """The same with other Q and Qc, which are linear in Q and Qc; of the parts, too."""
        Q, Qc = change(self.Q, self.Qc)
        parts = [ScaledPart(p.index, *change(p.Q, p.Qc), p.R) for p in self.parts]
        return dataclasses.replace(self, Q=Q, Qc=Qc, parts=tuple(parts))

    def R_at(self, u: ca.SX) -> ca.SX:
        """R at inputs (nu,): constant, unless inputs are what it is made of."""
        parts = [(p.index, p.R) for p in self.parts if p.R.any()]
        return ca.SX(noise_at(0 * self.R if parts else self.R, parts, u))

    def unsolved(self, x: ca.SX, u: ca.SX) -> ca.SX:
        """1 if the equations of the model, or of a sub-step from x, are not solved there."""
        left = ca.SX(0)
        if self.model.unsolved is not None:
            left = self.model.unsolved.call([x, u, ca.SX(self.model.theta)])[0]
        if self.model.continuous and self.integrator.substeps != "auto":
            h = self.dt / self.integrator.steps
            left = ca.fmax(left, self.integrator.left(self.model.rhs, x, u=u, h=h))
        if left.is_constant():
            return ca.SX(0)
        return ca.if_else(left < SOLVED, 0, 1)

    def physical(self, x: ca.SX, vP: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Physical state (nx,) and lower triangle of its covariance, of scaled ones."""
        return ca.SX(self.sx) * x, vech(unvech(vP) * ca.SX(np.outer(self.sx, self.sx)))


def setting(
    model: Model,
    dt: float,
    *,
    noise: Noise,
    prior: Prior,
    integrator: Integrator | None = None,
    noiseless: bool = False,
) -> Setting:
    """Check noise and prior against the model, all messages at once, and scale everything.

    A state without a `Signal.scale` is scaled by its prior and random walk, an output by its noise.
    The integrator settles what it leaves open. Sensors need noise, unless `noiseless` is set.

    Raises
    ------
    TuningError
        If anything does not fit.
    """
    if not model.continuous and not np.isclose(model.dt or 0.0, dt, rtol=1e-2):
        raise TuningError(f"the model has dt = {model.dt:g} s but the recording {dt:g} s")
    found: dict[str, Array] = {}
    problems = []
    for name, read in {
        "x0": lambda: prior.mean(model),
        "P0": lambda: prior.covariance(model),
        "Q": lambda: noise.process(model),
        "Qc": lambda: noise.density(model),
        "R": lambda: noise.measurement(model, singular=noiseless),
    }.items():
        try:
            found[name] = read()
        except BacksightError as error:
            problems.append(str(error))
    if problems:
        raise TuningError("; ".join(problems))
    x0, P0, chosen = found["x0"], found["P0"], EXACT
    if integrator is not None:
        over = np.sqrt(np.diag(P0))
        chosen = settle_steps(integrator, model, lambda: modes_over(model, x0, over), dt=dt)
    walk = np.diag(found["Q"]) + dt * np.diag(found["Qc"])
    typical = np.maximum(np.abs(x0), np.sqrt(np.diag(P0) + WALK_SAMPLES * walk))
    sized = dataclasses.replace(
        model,
        states=with_scales(model.states, typical),
        outputs=with_scales(model.outputs, np.sqrt(np.diag(found["R"]))),
    )
    still = np.zeros((1, model.nu))
    groups = sized.states, sized.inputs, sized.outputs
    sx, su, sy = (np.array([s.scale or 1.0 for s in group]) for group in groups)
    return Setting(
        model=scale(sized),
        dt=dt,
        x0=x0 / sx,
        P0=P0 / np.outer(sx, sx),
        Q=found["Q"] / np.outer(sx, sx),
        Qc=found["Qc"] / np.outer(sx, sx),
        R=found["R"] / np.outer(sy, sy),
        integrator=chosen,
        coarse=model.continuous
        and bool(complaint(chosen, lambda: modes_at(model, x0[None], still), dt=dt)),
        sx=sx,
        su=su,
        sy=sy,
        parts=scaled_parts(noise, model, sx, sy),
    )


def data_symbols(model: Model) -> tuple[ca.SX, ca.SX, ca.SX]:
    """u (nu,), y (ny,), mask (ny,)."""
    return ca.SX.sym("u", model.nu), ca.SX.sym("y", model.ny), ca.SX.sym("mask", model.ny)

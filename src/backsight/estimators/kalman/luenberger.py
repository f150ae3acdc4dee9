"""Luenberger observer: the eigenvalues of the error are chosen, the gain follows."""

import dataclasses
import warnings
from collections import Counter
from collections.abc import Iterator
from typing import Any, ClassVar, Literal, TypeAlias

import casadi as ca
import numpy as np
import scipy
from numpy.typing import NDArray

from backsight.algebra.update import measured, noise_of
from backsight.description import Printed, Sound
from backsight.discrete.runge_kutta import Hold
from backsight.engine.dense import UNROLL, all_entries, applied, few_entries, transpose
from backsight.engine.recursion import Recursion
from backsight.errors import TuningError
from backsight.estimators.base import ESTIMATE_CHANNELS, AbstractEstimator
from backsight.estimators.kalman._placed_poles import placed_gain
from backsight.estimators.kalman.kf import fixed_gain_halves
from backsight.estimators.parts.covariance import (
    Covariance,
    congruence,
    innovation_covariance,
    noise_of_many,
    times_transposed,
)
from backsight.estimators.parts.filtering import assemble, data_inputs, physical
from backsight.estimators.parts.fixed_gain import looked_of_many
from backsight.estimators.parts.flags import Flags
from backsight.estimators.parts.leaf import Results, half, leaf, notation
from backsight.estimators.parts.linear import Linear, linear, require_observable
from backsight.estimators.parts.memory import Memory
from backsight.estimators.parts.substeps import settled, within_bounds
from backsight.estimators.uncertainty import Noise, Prior
from backsight.models.model import Model
from backsight.types import Array

Form: TypeAlias = Literal["filtering", "prediction"]
"""Whether the estimate uses the measurement of its own sample."""


@dataclasses.dataclass(frozen=True)
class Observer(Printed):
    """A gain and what it does; prints itself.

    Parameters
    ----------
    gain : (nx, ny) array
        Physical units; multiplies the innovation in the form chosen.
    eigenvalues : (nx,) complex array
        Of the estimation error, from sample to sample.
    dt : float
        Sampling period [s].
    form : {"filtering", "prediction"}
    """

    gain: Array
    eigenvalues: NDArray[np.complex128]
    dt: float
    form: Form

    def __str__(self) -> str:
        gain = np.array2string(self.gain, precision=6, prefix="  gain ")
        lines = [f"Luenberger observer, {self.form} form", f"  gain {gain}"]
        for value in self.eigenvalues:
            size = abs(value)
            fades = "gone after nx samples" if size < 1e-6 else f"{-self.dt / np.log(size):.3g} s"
            lines.append(f"  error eigenvalue {value:.6g}: modulus {size:.6g}, fades with {fades}")
        return "\n".join(lines)


@dataclasses.dataclass(frozen=True)
class Luenberger(AbstractEstimator):
    r"""Luenberger observer.

    A copy of the plant that is corrected by the innovation with a constant gain. In the filtering
    form the estimate uses the measurement of its own sample,

    .. math:: \hat x_{k|k} = \hat x_{k|k-1} + \tilde L (y_k - C \hat x_{k|k-1} - D u_k), \qquad
        \hat x_{k+1|k} = A \hat x_{k|k} + B u_k,

    in the prediction form, for computers that are not so fast, only the earlier ones,

    .. math:: \hat x_{k+1|k} = A \hat x_{k|k-1} + B u_k + L (y_k - C \hat x_{k|k-1} - D u_k).

    With :math:`L = A \tilde L` they are the same observer. The error evolves by A - L C, whose
    eigenvalues are the `poles`.

    Parameters
    ----------
    noise : Noise
        Does not change the estimate, but the covariance: that of the error that this gain makes.
    prior : Prior
    poles : tuple of complex
        One per state, from sample to sample (a pole s of a continuous observer is
        :math:`e^{s\,dt}`): inside the unit circle, complex ones in conjugate pairs, none more often
        than there are outputs.
    form : {"filtering", "prediction"}
        Whether an estimate knows the measurement of its own sample.
    hold : {"zoh", "foh"}
        Input between the samples of a continuous model: held, or interpolated.

    References
    ----------
    Luenberger, "An introduction to observers", 1971, doi:10.1109/TAC.1971.1099826.
    Tits, Yang, "Globally convergent algorithms for robust pole assignment by state feedback", 1996,
    doi:10.1109/9.539425: the gain, if there are several outputs; of more than a dozen states
    it comes from a Sylvester equation, see `backsight.estimators.kalman._placed_poles`.

    Examples
    --------
    >>> observer = bs.Luenberger(bs.Noise(sigma_y=1e-3), bs.Prior(sigma_x0=1.0), poles=(0.8, 0.7))
    >>> recording = bs.simulate(bs.sdof(k=40.0, b=0.8), [[1.0]] * 80, dt=0.05, sigma_y=1e-4, seed=1)
    >>> result = bs.estimate(observer, bs.sdof(k=40.0, b=0.8), recording, engine="vm")
    >>> abs(float(result.e[-1, 0])) < 1e-3
    True
    """

    key: ClassVar[str] = "luenberger"
    title: ClassVar[str] = "Luenberger observer"
    weighs: ClassVar[bool] = True
    multiplied_settings: ClassVar[tuple[str, ...]] = ("poles",)

    noise: Noise
    prior: Prior
    poles: tuple[complex, ...]
    form: Form = "filtering"
    hold: Hold = "zoh"

    def conflicts(self, sound: Sound) -> Iterator[str]:
        """See `Description.conflicts`."""
        if not sound("poles"):
            return
        for pole in self.poles:
            if not abs(pole) < 1:
                yield f"pole {_shown(pole)} is not inside the unit circle; the error would grow"
        count = Counter(self.poles)
        alone = [p for p in self.poles if p.imag and count[p] != count[p.conjugate()]]
        if alone:
            yield (
                f"pole {_shown(alone[0])} has no conjugate partner; add "
                f"{_shown(alone[0].conjugate())}"
            )

    def observer(self, model: Model, dt: float) -> Observer:
        """Gain in physical units, and the eigenvalues of the error as computed from it."""
        system = self._system(model, dt)
        gain = self._gain(system, model)
        s = system.s
        return Observer(
            gain=gain * s.sx[:, None] / s.sy,
            eigenvalues=np.linalg.eigvals(_error(system, gain, self.form)).astype(complex),
            dt=dt,
            form=self.form,
        )

    @property
    def constant_gain(self) -> bool:
        """See `AbstractEstimator.constant_gain`."""
        return True

    def build(self, model: Model, dt: float) -> Recursion:
        """See `AbstractEstimator.build`."""
        system = self._system(model, dt)
        gain = self._gain(system, model)
        if self.form == "prediction":
            return _predicting(self.key, system, gain)
        return assemble(self.key, system.s, fixed_gain_halves(system, gain))

    def _system(self, model: Model, dt: float) -> Linear:
        return linear(model, dt, noise=self.noise, prior=self.prior, hold=self.hold)

    def _gain(self, system: Linear, model: Model) -> Array:
        ny, nx = system.C.shape
        if len(self.poles) != nx:
            raise TuningError(f"{len(self.poles)} poles are given for {nx} states; give {nx}")
        pole, times = Counter(self.poles).most_common(1)[0]
        if times > ny:
            raise TuningError(
                f"pole {_shown(pole)} is given {times} times; with {ny} output"
                f"{'s' if ny > 1 else ''} at most {ny} can be equal: spread them a little"
            )
        require_observable(model)
        if self.form == "filtering" and np.linalg.cond(system.A) > 1e12:
            raise TuningError(
                "the transition matrix is singular, so that the filtering form has fixed poles at "
                "zero; use form = 'prediction'"
            )
        seen = system.C @ system.A if self.form == "filtering" else system.C
        if nx > UNROLL:
            return placed_gain(system.A, seen, self.poles)
        with warnings.catch_warnings():
            # Only how robust the choice among the possible gains is stays below its optimum.
            warnings.filterwarnings("ignore", message="Convergence was not reached")
            placed: Any = scipy.signal.place_poles(
                system.A.T, seen.T, np.array(self.poles), maxiter=100
            )
        return np.asarray(placed.gain_matrix, float).T


def _error(system: Linear, gain: Array, form: str) -> Array:
    seen = system.C @ system.A if form == "filtering" else system.C
    return system.A - gain @ seen


def _predicting(name: str, system: Linear, L: Array) -> Recursion:
    """Recursion of the prediction form; the memory lacks the part of an interpolated input."""
    s = system.s
    kept = Covariance(s.model.nx)
    data = data_inputs(s)
    u, y, mask = s.enter()(*data)
    m = Memory(z=s.x0, P=kept.kept(s.P0), started=0)
    observe = _observe_many(system, L) if kept.whole else _observe(system, L)
    x, e, S, flags, z, P = observe(m.z, m.P, m.started, u, y, mask)
    (spread,) = kept.triangle().call([m.P], kept.whole, False)
    return m.recursion(
        name,
        data,
        next={"z": z, "P": P, "started": 1},
        outputs=physical(s, x=x, P=spread, u=u, e=e, S=S, flags=flags),
        channels=ESTIMATE_CHANNELS,
        dt=s.dt,
    )


def _observe(system: Linear, L: Array) -> ca.Function:
    """One sample: ``(z, P, started, u, y, mask) -> (x, e, S, flags, z_next, P_next)``."""
    s = system.s
    A, B, B_next, C = (ca.sparsify(ca.DM(k)) for k in (system.A, system.B, system.B_next, system.C))

    def formula(z: ca.SX, P: ca.SX, started: ca.SX, u: ca.SX, y: ca.SX, mask: ca.SX) -> Results:
        free = z + started * ca.mtimes(B_next, u)
        x, seen, R = within_bounds(s, free), measured(mask), noise_of(ca.SX(s.R), mask)
        e = seen * (y - s.model.output(x, u))
        gain = ca.SX(ca.DM(L)) @ ca.diag(seen)
        error = ca.SX(A) - gain @ C
        flags = Flags(clipped=ca.if_else(ca.norm_1(x - free) > 0, 1, 0))
        return {
            "x": x,
            "e": e,
            "S": ca.densify(ca.SX(C) @ P @ C.T + R),
            "flags": flags.vector(),
            "z_next": ca.mtimes(A, x) + ca.mtimes(B, u) + ca.mtimes(ca.DM(L), e),
            "P_next": ca.densify(error @ P @ error.T + gain @ R @ gain.T + ca.SX(s.Q)),
        }

    return leaf("observe", {**notation(s), "z": s.model.nx, "started": 1}, formula)


def _observe_many(system: Linear, L: Array) -> ca.Function:
    """`_observe` of many states."""
    s = system.s
    A, B, B_next, C = (ca.MX(few_entries(k)) for k in (system.A, system.B, system.B_next, system.C))

    def formula(
        z: ca.MX, P: ca.MX, started: ca.MX, u: ca.MX, y: ca.MX, mask: ca.MX
    ) -> dict[str, ca.MX]:
        free = z + started * applied(B_next, u)
        x, flags = settled(s)(free, ca.MX.ones(s.model.nx), ca.MX.ones(s.model.ny))
        e, gain = looked_of_many(system, L, (x, u, y, mask))
        noise = noise_of_many(ca.MX(ca.DM(s.R)), mask)
        error = all_entries(A) - times_transposed(gain, transpose(all_entries(C)))
        added = ca.MX(ca.DM(s.Q)) + congruence(gain, noise, 0 * s.Q)
        return {
            "x": x,
            "e": e,
            "S": innovation_covariance(P, C, s.R, mask),
            "flags": flags,
            "z_next": applied(A, x) + applied(B, u) + applied(ca.DM(L), e),
            "P_next": congruence(error, P, added),
        }

    return half("observe", s, formula, {"z": s.model.nx, "started": 1})


def _shown(pole: complex) -> str:
    return f"{pole.real:g}" if pole.imag == 0 else f"{pole:g}"

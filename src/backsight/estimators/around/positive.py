r"""States that cannot be negative: estimated as logarithms, put out as they are.

A parameter that is positive, a mass or a stiffness, is :math:`x = x_0 e^z`, with the state z in its
place, which may be any number: the estimate cannot reach zero, and no bound locks it. Everything
that a user writes and reads stays in units of x: prior and noise are carried over at the start
value, and from an estimate :math:`\hat z \pm \sigma_z` come the median :math:`x_0 e^{\hat z}`, the
standard deviation :math:`x\,\sigma_z` to first order, and the band from :math:`x e^{-\sigma_z}` to
:math:`x e^{\sigma_z}`.

The prior of z has the median x0 and the variance that makes that of x, relative to x0 squared, the
one given: :math:`\sigma_z^2 = \ln(1 + \sigma^2 / x_0^2)`. Source: Limpert, Stahel, Abbt,
"Log-normal distributions across the sciences: keys and clues", 2001, BioScience 51(5).
"""

import dataclasses

import casadi as ca
import numpy as np

from backsight.algebra.symmetric import unvech, vech
from backsight.engine.recursion import Channel, Recursion
from backsight.errors import TuningError
from backsight.estimators.uncertainty import Noise, Prior
from backsight.models.model import Model
from backsight.models.signals import Signal, along
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class Logarithmic:
    """A model with logarithms in place of its positive states, its noise and prior.

    Parameters
    ----------
    model : Model
    noise, prior
    at : (nx,) array
        Start values of the positive states, NaN for the others.
    """

    model: Model
    noise: Noise
    prior: Prior
    at: Array


def logarithmic(noise: Noise, prior: Prior, model: Model) -> Logarithmic:
    """Put logarithms in the place of positive states.

    Raises
    ------
    TuningError
        If one of them starts at zero or below, or noise or prior do not fit.
    """
    x0, P0 = prior.mean(model), prior.covariance(model)
    chosen = np.array([s.positive for s in model.states])
    below = [s.name for s, v in zip(model.states, x0, strict=True) if s.positive and not v > 0]
    if below:
        raise TuningError(
            f"{', '.join(below)}: positive, but starts at zero or below; give a start above zero"
        )
    at = np.where(chosen, x0, np.nan)
    unit = np.where(chosen, x0, 1.0)
    x, p = ca.SX.sym("z", model.nx), ca.SX.sym("p", len(model.parameters))
    u = ca.SX.sym("u", model.nu)
    natural = _natural(at)(x)
    rows = ca.vertsplit(model.f.call([natural, u, p])[0])
    for i in np.flatnonzero(chosen).tolist():
        moved = rows[i] / natural[i] if model.continuous else ca.log(rows[i] / unit[i])
        # A constant stays one to the last bit.
        rows[i] = x[i] if not model.continuous and _is_same(rows[i], natural[i]) else moved
    given = [natural, u, p]
    w = ca.SX.sym("w", model.nx)
    slopes = ca.vertcat(*(natural[i] if c else ca.SX(1) for i, c in enumerate(chosen)))
    inner = dataclasses.replace(
        model,
        f=ca.Function("f", [x, u, p], [ca.vertcat(*rows)]),
        h=ca.Function("h", [x, u, p], model.h.call(given)),
        states=tuple(_logarithm(s, v) if s.positive else s
                     for s, v in zip(model.states, x0, strict=True)),
        unsolved=model.unsolved_at([x, u, p], given),
        virtual=along(model.virtual, [x, u, p, w], [*given, slopes * w]),
    )  # fmt: skip
    # The size of the prior is that of the lognormal distribution, correlations stay.
    relative = np.sqrt(np.diag(P0)) / unit
    share = np.ones(model.nx)
    wide = chosen & (relative > 0)
    share[wide] = np.sqrt(np.log1p(relative[wide] ** 2)) / relative[wide]
    by = np.outer(share / unit, share / unit)
    scaled = np.outer(1 / unit, 1 / unit)
    kept = dataclasses.replace(noise, sigma_w=None, Q=noise.stated_process(model) * scaled, Qc=None)
    if noise.Qc is not None:
        kept = dataclasses.replace(kept, Q=None, Qc=noise.stated_density(model) * scaled)
    if noise.cross is not None:
        kept = dataclasses.replace(kept, cross=np.asarray(noise.cross) / unit[:, None])
    start = np.where(chosen, 0.0, x0)
    return Logarithmic(inner, kept, Prior(x0=start, P0=P0 * by), at)


def in_their_units(plain: Recursion, at: Array) -> Recursion:
    """Put out states, and what belongs to them, in their own units."""
    data = [ca.MX.sym(f"d{i}", n) for i, n in enumerate((len(plain.carry0), *plain.input_sizes))]
    carry, *values = plain.step.call(data, True, False)
    named = dict(zip((c.name for c in plain.channels), values, strict=True))
    x = _natural(at)(named["x_hat"])
    found = [
        x if c.name == "x_hat" else _stretched(c, v, x, at)
        for c, v in zip(plain.channels, values, strict=True)
    ]
    return dataclasses.replace(plain, step=ca.Function(plain.name, data, [carry, *found]))


def _stretched(channel: Channel, value: ca.MX, x: ca.MX, at: Array) -> ca.MX:
    """A deviation or a covariance, by the derivative of the state by its logarithm."""
    n = len(at)
    natural = ca.SX.sym("x", n)
    slope = ca.vertcat(*(natural[i] if np.isfinite(at[i]) else ca.SX(1) for i in range(n)))
    v = ca.SX.sym("v", value.numel())
    if channel.dims == ("state", "state_"):
        stretched = vech(unvech(v) * (slope @ slope.T))
    elif channel.dims == ("state",):
        stretched = v * slope
    else:
        return value
    return ca.Function(f"stretched_{channel.name}", [v, natural], [ca.densify(stretched)])(value, x)


def _natural(at: Array) -> ca.Function:
    """States with logarithms to states."""
    z = ca.SX.sym("z", len(at))
    rows = [v * ca.exp(z[i]) if np.isfinite(v) else z[i] for i, v in enumerate(at)]
    return ca.Function("natural", [z], [ca.vertcat(*rows)])


def _logarithm(s: Signal, start: float) -> Signal:
    with np.errstate(divide="ignore"):
        lower, upper = (float(np.log(max(v, 0.0) / start)) for v in (s.lower, s.upper))
    return Signal(name=s.name, lower=lower, upper=upper)


def _is_same(a: ca.SX, b: ca.SX) -> bool:
    return ca.is_equal(a, b, 10)

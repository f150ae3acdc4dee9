r"""Virtual outputs of every method: quantities of a model that no sensor measures, with bands.

They are computed around the method, from what it puts out. Of an estimate :math:`\hat x` with the
covariance P, to first order (exact for linear quantities),

.. math::
    \hat z = g(\hat x, u, p, 0), \qquad
    \sigma_z^2 = G P G' + G_w W G_w', \qquad
    G = \frac{\partial g}{\partial x}, \; G_w = \frac{\partial g}{\partial w} .

A quantity that contains the rate of a state, such as an acceleration, contains the process noise of
the coming sampling period. That is taken as constant over the period:
:math:`W = Q / \Delta t^2 + Q_c / \Delta t`. A filter knows nothing of it yet. An estimate that
looks back does: its error and w then depend on each other in a way that is not put out, and the
deviations are added in place of the variances, which is never too little.
"""

import dataclasses
from collections.abc import Mapping

import casadi as ca
import numpy as np

from backsight.algebra.symmetric import side
from backsight.engine.recursion import Channel, ForwardBackward, Recursion
from backsight.errors import TuningError
from backsight.estimators.around.virtual_bands import (
    Surroundings,
    apart,
    of_states,
    slopes_of,
    together,
    variance_of,
)
from backsight.estimators.uncertainty import Noise
from backsight.models.model import Model
from backsight.models.signals import Virtual
from backsight.schema import VIRTUAL, VIRTUAL_STD
from backsight.types import Array

CROSS = "P_xd"
"""Channel by which a method may tell the covariance of states and unknown forces, (nx, nf)."""


def surroundings(
    model: Model, dt: float, *, noise: Noise | None, background: Array
) -> Surroundings:
    """Process noise as rates; in discrete time, as steps."""
    if noise is None:
        return Surroundings(model, np.zeros((model.nx, model.nx)), background)
    period = dt if model.continuous else 1.0
    W = noise.process(model) / period**2 + noise.density(model) / period
    return Surroundings(model, W, background)


def with_virtual_outputs(plain: Recursion, around: Surroundings) -> Recursion:
    """Put out the virtual outputs, too. The memory has the plain one's in front.

    Of an estimate that is about an earlier sample, the inputs of that sample wait.
    """
    nu, _, _ = plain.input_sizes
    lag, inside_size = plain.lag, len(plain.carry0)
    carry = ca.MX.sym("carry", inside_size + nu * lag)
    data = [ca.MX.sym(f"d{i}", size) for i, size in enumerate(plain.input_sizes)]
    inside, waiting = carry[:inside_size], carry[inside_size:]
    after, *values = plain.step.call([inside, *data], True, False)
    queue = ca.horzcat(ca.reshape(waiting, nu, lag), data[0])
    channels, found = _extended(plain.channels, values, queue[:, 0], around, looks_back=lag > 0)
    innovation = plain.innovation
    if innovation is not None:
        known = ca.Function("innovation", [carry, *data], innovation.call([inside, *data]))
        innovation = known
    return dataclasses.replace(
        plain,
        step=ca.Function(
            plain.name, [carry, *data], [ca.vertcat(after, ca.vec(queue[:, 1:])), *found]
        ),
        carry0=np.concatenate([plain.carry0, np.zeros(nu * lag)]),
        channels=channels,
        innovation=innovation,
    )


def smoothed_with_virtual_outputs(passes: ForwardBackward, around: Surroundings) -> ForwardBackward:
    """Put out the virtual outputs of smoothed estimates, too."""
    back = passes.backward
    symbols = [ca.MX.sym("carry", len(back.carry0))]
    symbols += [ca.MX.sym(f"d{i}", size) for i, size in enumerate(back.input_sizes)]
    after, *values = back.step.call(symbols, True, False)
    u = symbols[-4]  # before u_next, y and mask
    channels, found = _extended(back.channels, values, u, around, looks_back=True)
    step = ca.Function(back.name, symbols, [after, *found])
    return dataclasses.replace(
        passes, backward=dataclasses.replace(back, step=step, channels=channels)
    )


DEVIATIONS = {"P": Channel("x_std", ("state",)), "P_d": Channel("d_std", ("force",))}
"""What is put out in the place of covariances."""


def without_covariance(passes: ForwardBackward) -> ForwardBackward:
    """Put out standard deviations in place of covariances, and none of the innovations."""
    return ForwardBackward(_shortened(passes.forward), _shortened(passes.backward))


def _shortened(plain: Recursion) -> Recursion:
    symbols = [ca.MX.sym(f"d{i}", plain.step.numel_in(i)) for i in range(plain.step.n_in())]
    after, *values = plain.step.call(symbols, True, False)
    kept = []
    for channel, value in zip(plain.channels, values, strict=True):
        if channel.name in DEVIATIONS:
            labelled = dataclasses.replace(DEVIATIONS[channel.name], labels=channel.labels)
            kept.append((labelled, _roots(side(value.numel()))(value)))
        elif channel.name != "S":
            kept.append((channel, value))
    return dataclasses.replace(
        plain,
        step=ca.Function(plain.name, symbols, [after, *(v for _, v in kept)]),
        channels=tuple(c for c, _ in kept),
    )


def _roots(n: int) -> ca.Function:
    """Lower triangle of a covariance to standard deviations (n,)."""
    triangle = ca.SX.sym("P", n * (n + 1) // 2)
    places = [int(k) for k in np.cumsum([0, *range(n, 1, -1)])]
    return ca.Function("deviations", [triangle], [ca.sqrt(ca.fmax(triangle[places], 0))])


def _extended(
    channels: tuple[Channel, ...],
    values: list[ca.MX],
    u: ca.MX,
    around: Surroundings,
    *,
    looks_back: bool,
) -> tuple[tuple[Channel, ...], list[ca.MX]]:
    """Channels and values of a step with those of virtual outputs, without `CROSS`."""
    virtual = around.model.virtual
    assert virtual is not None
    named = {c.name: v for c, v in zip(channels, values, strict=True)}
    forces = next((c for c in channels if c.name == "d_hat"), None)
    found = _estimates(virtual, named, u, around, forces, looks_back=looks_back)
    labels = tuple(s.name for s in virtual.signals)
    kept = [(c, named[c.name]) for c in channels if c.name != CROSS]
    kept += [(Channel(n, ("virtual",), labels=labels), v) for n, v in found.items()]
    return tuple(c for c, _ in kept), [v for _, v in kept]


def _estimates(
    virtual: Virtual,
    named: Mapping[str, ca.MX],
    u: ca.MX,
    around: Surroundings,
    forces: Channel | None,
    *,
    looks_back: bool,
) -> dict[str, ca.MX]:
    """Estimates and standard deviations of the virtual outputs of a sample."""
    names = () if forces is None else forces.labels
    slopes, constant = slopes_of(virtual, around, names)
    direct = bool(slopes.sparsity_out("Gd").nnz())
    if direct and (forces is None or forces.ago):
        raise TuningError(_too_late(virtual, slopes))

    # 1. Estimates, and their derivatives by states and by unknown forces.
    x, d = named["x_hat"], named["d_hat"] if names else ca.MX(0, 1)
    z, Gt, Gd, of_noise = slopes(x, u, d)
    variance = variance_of(named["P"], Gt, constant)

    # 2. Deviations by what is known of states and forces together, or of each by itself.
    if direct and CROSS in named:
        known = [named[CROSS], named["P_d"]]
        sigma = together(slopes, looks_back=looks_back)(variance, of_noise, Gt, Gd, *known)
    elif direct:
        sigma = apart(slopes, around, looks_back=looks_back)(variance, of_noise, Gd, named["d_std"])
    else:
        sigma = of_states(slopes, looks_back=looks_back)(variance, of_noise)
    return {VIRTUAL: z, VIRTUAL_STD: sigma}


def _too_late(virtual: Virtual, slopes: ca.Function) -> str:
    rows = set(slopes.sparsity_out("Gd").row())
    names = ", ".join(f"'{s.name}'" for i, s in enumerate(virtual.signals) if i in rows)
    contain = "outputs {} contain" if len(rows) > 1 else "output {} contains"
    return (
        f"virtual {contain.format(names)} an unknown force of its own sample, which these sensors "
        "show one sample later; add an accelerometer, or let the force walk or follow a process: "
        "make it a state with 'augment' ([estimate] or [forces] in a problem file) and take a "
        "Kalman filter"
    )

"""The same model in scaled variables (eq. 37)."""

import dataclasses

import casadi as ca
import numpy as np

from backsight.description import checked
from backsight.errors import ModelError
from backsight.models._affine import remember, remembered
from backsight.models.forces.driven import Driven
from backsight.models.model import Model
from backsight.models.signals import Signal
from backsight.types import Array


@checked(ModelError)
def scale(model: Model) -> Model:
    r"""Divide every state, input and output by its `Signal.scale` (eq. 37).

    With :math:`x = S_x x_s`, :math:`u = S_u u_s`, :math:`y = S_y y_s` the model becomes
    :math:`\dot x_s = S_x^{-1} f(S_x x_s, S_u u_s, p)`. Signals without a scale keep theirs (1).
    Values and bounds are scaled too; units become "1" where a scale was applied.

    Source: Polóni et al., ACC 2012, eq. 37.

    Examples
    --------
    >>> bs.models.scale(bs.duffing(k1=4e6, d=70.0, k3=5.0)).states[0].name
    'q'
    """
    sx, su, sy = (
        np.array([s.scale or 1.0 for s in group])
        for group in (model.states, model.inputs, model.outputs)
    )
    x, u = ca.SX.sym("x", model.nx), ca.SX.sym("u", model.nu)
    p = ca.SX.sym("p", len(model.parameters))
    f = ca.Function("f", [x, u, p], [model.f.call([sx * x, su * u, p])[0] / sx])
    h = ca.Function("h", [x, u, p], [model.h.call([sx * x, su * u, p])[0] / sy])
    for new, old, size in ((f, model.f, sx), (h, model.h, sy)):
        if known := remembered(old, model.theta):
            by_x, by_u, constants = known
            known = by_x * sx / size[:, None], by_u * su / size[:, None], constants / size
            remember(new, model.theta, known)
    return dataclasses.replace(
        model,
        f=f,
        h=h,
        states=tuple(map(_scaled, model.states)),
        inputs=tuple(map(_scaled, model.inputs)),
        outputs=tuple(map(_scaled, model.outputs)),
        unsolved=model.unsolved_at([x, u, p], [ca.SX(sx) * x, ca.SX(su) * u, p]),
        driven=tuple(_in_scale(group, model, sx) for group in model.driven),
        virtual=None,
    )


def _in_scale(group: Driven, model: Model, sx: Array) -> Driven:
    size = sx[[model.index(name) for name in group.states]]
    by = np.outer(size, size)
    scaled = {"noise": group.noise / by, "stationary": group.stationary / by}
    return dataclasses.replace(group, **scaled, process=None)


def _scaled(s: Signal) -> Signal:
    if s.scale is None:
        return s
    return dataclasses.replace(
        s,
        unit="1",
        value=s.value / s.scale,
        lower=s.lower / s.scale,
        upper=s.upper / s.scale,
        scale=None,
        saturation=s.saturation and (s.saturation[0] / s.scale, s.saturation[1] / s.scale),
        **{
            field: value / s.scale
            for field in ("dummy", "wrap", "resolution")
            if (value := getattr(s, field)) is not None
        },
    )

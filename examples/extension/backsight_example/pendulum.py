"""A pendulum with a motor, seen from the side."""

import casadi as ca

from backsight import Model, Signal


def pendulum(length: float, damping: float = 0.1, name: str = "pendulum") -> Model:
    r"""Point mass on a rod, everything per unit of inertia.

    .. math:: \ddot\varphi = -\tfrac{g}{l} \sin\varphi - d\,\dot\varphi + M

    Parameters
    ----------
    length : float
        Of the rod [m].
    damping : float
        [1/s].
    name : str
        Shown in results.
    """
    return Model(
        f=lambda x, u, p: [x.rate, -9.81 / p.length * ca.sin(x.angle) - p.damping * x.rate + u.M],
        h=lambda x, _, p: [p.length * ca.sin(x.angle)],
        states={"angle": "rad", "rate": "rad/s"},
        inputs={"M": "1/s2"},
        outputs={"aside": "m"},
        parameters={
            "length": Signal("m", length, lower=0.01),
            "damping": Signal("1/s", damping, lower=0.0),
        },
        name=name,
    )

"""Ten plants: stiff, unstable, not observable, changing in time, of several rates, nonlinear."""

import dataclasses
from collections.abc import Callable, Sequence

import casadi as ca
import numpy as np

import backsight as bs
from backsight.discrete.exact import zoh
from backsight.discrete.runge_kutta import Integrator
from backsight.engine.recursion import Channel, Recursion
from backsight.models.lti import state_equation
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class Plant:
    """A machine with its noise, and what keeps it where it is.

    Parameters
    ----------
    name : str
    model : Model
        Its parameter F, where it has one, is an unknown force.
    dt : float
        [s].
    sigma_w, sigma_y : tuple of float
        Of all states, per sample, and of all outputs.
    push : tuple of float
        Standard deviations of the known inputs.
    feedback : tuple of float
        The first input is less by the product of these with the states: it holds what would run
        away. Estimators are told the input.
    turns : float
        By how much the second input, an angle, goes on per sample [rad].
    every : tuple of int
        Each output is measured once in so many samples.
    """

    name: str
    model: bs.Model
    dt: float
    sigma_w: tuple[float, ...]
    sigma_y: tuple[float, ...]
    push: tuple[float, ...] = (1.0,)
    feedback: tuple[float, ...] = ()
    turns: float = 0.0
    every: tuple[int, ...] = ()

    @property
    def noise(self) -> bs.Noise:
        """What estimators are told of the noise: the truth."""
        names = [s.name for s in self.model.states], [s.name for s in self.model.outputs]
        return bs.Noise(
            sigma_w=dict(zip(names[0], self.sigma_w, strict=True)),
            sigma_y=dict(zip(names[1], self.sigma_y, strict=True)),
        )

    @property
    def prior(self) -> bs.Prior:
        """The first state is drawn from it."""
        return bs.Prior(sigma_x0=0.1)

    def truth(self) -> Recursion:
        """``(x, push, angle, w, v) -> (x, x, u, y)``: the machine from sample to sample."""
        m = self.model
        x, w, v = (ca.SX.sym(k, n) for k, n in (("x", m.nx), ("w", m.nx), ("v", m.ny)))
        push, angle = ca.SX.sym("push"), ca.SX.sym("angle")
        u = ca.vertcat(push, angle)[: m.nu]
        if self.feedback:
            u[0] -= ca.dot(ca.DM(self.feedback), x)
        linear = state_equation(m)
        if linear is not None:
            A, B = zoh(*linear[:2], dt=self.dt)
            ahead = ca.DM(A) @ x + ca.DM(B) @ u
        else:
            ahead = x
            for _ in range(SUBSTEPS):
                ahead = FINE.substep(m.rhs, ahead, ua=u, ub=u, h=self.dt / SUBSTEPS)
        results = [ahead + w, x, u, m.output(x, u) + v]
        return Recursion(
            step=ca.Function("truth", [x, push, angle, w, v], [ca.densify(k) for k in results]),
            carry0=0.1 * np.random.default_rng(1).standard_normal(m.nx),
            channels=(
                Channel("x", ("state",)),
                Channel("u", ("input",)),
                Channel("y", ("output",)),
            ),
            dt=self.dt,
        )

    def drawn(self, first: int, n: int, rng: np.random.Generator) -> list[Array]:
        """What the truth takes from the sample `first` on."""
        at = np.arange(first, first + n)
        angle = np.mod(self.turns * at, 2 * np.pi)[:, None]
        w, v = (rng.standard_normal((n, len(s))) * s for s in (self.sigma_w, self.sigma_y))
        return [self.push[0] * rng.standard_normal((n, 1)), angle, w, v]

    def measured(self, first: int, n: int) -> Array:
        """Which outputs are measured, (n, ny)."""
        at = np.arange(first, first + n)[:, None]
        return (at % np.array(self.every or (1,) * self.model.ny) == 0).astype(float)


SUBSTEPS = 4
FINE = Integrator("rk4", SUBSTEPS)


def plants() -> Sequence[Plant]:
    """All of them; those that are linear and do not change come first."""
    return (
        Plant("light damping", _oscillators((1.0,), (1e-3,), (1.0,)), 0.02, (0.0, 1e-3), (1e-2,)),
        Plant(
            "stiff: 1 and 2000 Hz",
            _oscillators((1.0, 2000.0), (0.01, 0.02), (1.0, 1.0)),
            0.01,
            (0.0, 0.0, 1e-3, 1e-3),
            (1e-2,),
        ),
        Plant(
            "unstable, held",
            _model(lambda x, u, p: [x.v, 9 * x.q + u.a + p.F]),
            0.02,
            (0.0, 1e-3),
            (1e-2,),
            feedback=(25.0, 6.0),
        ),
        Plant(
            "free mass, held",
            _model(lambda x, u, p: [x.v, u.a + p.F]),
            0.02,
            (0.0, 1e-3),
            (1e-2,),
            feedback=(4.0, 2.8),
        ),
        Plant(
            "hidden mode that decays",
            _oscillators((1.0, 1.7), (0.01, 0.05), (1.0, 0.0)),
            0.02,
            (0.0, 0.0, 1e-3, 1e-3),
            (1e-2,),
        ),
        Plant(
            "hidden mode, undamped",
            _oscillators((1.0, 1.7), (0.01, 0.0), (1.0, 0.0)),
            0.02,
            (0.0, 0.0, 1e-3, 0.0),
            (1e-2,),
        ),
        Plant(
            "two rates",
            _model(
                lambda x, u, p: [x.v, -40 * x.q - 0.2 * x.v + u.a + p.F],
                h=lambda x, _u, _p: [x.q, x.v],
                outputs=("y", "rate"),
            ),
            0.02,
            (0.0, 1e-3),
            (1e-2, 1e-1),
            every=(5, 1),
        ),
        Plant(
            "turning",
            _model(
                lambda x, u, _p: [x.v, -(40 + 8 * np.cos(u.angle)) * x.q - 0.2 * x.v + u.a],
                h=lambda x, u, _p: [np.cos(u.angle) * x.q],
                inputs=("a", "angle"),
                forces=(),
            ),
            0.02,
            (0.0, 1e-3),
            (1e-2,),
            turns=0.37,
        ),
        Plant(
            "hardening spring",
            _model(lambda x, u, _p: [x.v, -40 * x.q - 400 * x.q**3 - 0.2 * x.v + u.a], forces=()),
            0.02,
            (0.0, 1e-3),
            (1e-2,),
            push=(4.0,),
        ),
        Plant("unknown stiffness", _unknown_stiffness(), 0.02, (0.0, 1e-3, 1e-4), (1e-2,)),
    )


def _model(
    f: Callable[..., list],
    *,
    h: Callable[..., list] = lambda x, _u, _p: [x.q],
    inputs: Sequence[str] = ("a",),
    outputs: Sequence[str] = ("y",),
    forces: Sequence[str] = ("F",),
) -> bs.Model:
    return bs.Model(
        f=f,
        h=h,
        states={"q": "m", "v": "m/s"},
        inputs=dict.fromkeys(inputs, ""),
        outputs=dict.fromkeys(outputs, ""),
        parameters=dict.fromkeys(forces, 0.0),
    )


def _oscillators(
    hertz: Sequence[float], damping: Sequence[float], seen: Sequence[float]
) -> bs.Model:
    ones = np.ones(len(hertz))
    return bs.modal(
        hertz,
        damping=damping,
        sensors={"y": ("displacement", seen)},
        forces={"F": ones},
        inputs={"a": ones},
    )


def _unknown_stiffness() -> bs.Model:
    spring = bs.Model(
        f=lambda x, u, p: [x.v, -40 * (1 + 0.1 * np.tanh(p.k)) * x.q - 0.2 * x.v + u.a],
        h=lambda x, _u, _p: [x.q],
        states={"q": "m", "v": "m/s"},
        inputs={"a": ""},
        outputs={"y": ""},
        parameters={"k": 0.0},
    )
    return bs.augment(spring, parameters=["k"])

"""Ten machines with known noise, to be tuned from settings that are wrong by large factors."""

import dataclasses
from collections.abc import Callable, Mapping

import casadi as ca
import numpy as np
import xarray as xr

import backsight as bs
from backsight.discrete.steps import advanced
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class Machine:
    """A machine as it is simulated.

    Parameters
    ----------
    name : str
    model : Model
    dt : float
        Sampling period [s].
    samples : int
    sigma_y, sigma_w : dict
        Noise of every output; step of every state that walks.
    sigma_x0 : dict
        Standard deviation of the first state around that of the model.
    drive : callable
        Inputs (n, nu) of n samples.
    """

    name: str
    model: bs.Model
    dt: float
    samples: int
    sigma_y: Mapping[str, float]
    sigma_w: Mapping[str, float]
    sigma_x0: Mapping[str, float]
    drive: Callable[[int, np.random.Generator], Array]

    def estimator(self, *, y: float = 1.0, w: float = 1.0) -> bs.EKF:
        """An extended Kalman filter whose standard deviations are wrong by factors."""
        return bs.EKF(
            bs.Noise(
                sigma_y={n: y * s for n, s in self.sigma_y.items()},
                sigma_w={n: w * s for n, s in self.sigma_w.items()},
            ),
            bs.Prior(sigma_x0=dict(self.sigma_x0)),
        )

    def record(self, seed: int, *, samples: int | None = None) -> tuple[xr.Dataset, Array]:
        """A recording, and its true states (n, nx)."""
        rng, n, m = np.random.default_rng(seed), samples or self.samples, self.model
        u = self.drive(n, rng)
        w = rng.standard_normal((n, m.nx)) * [self.sigma_w.get(s.name, 0.0) for s in m.states]
        v = rng.standard_normal((n, m.ny)) * [self.sigma_y[s.name] for s in m.outputs]
        spread = np.array([self.sigma_x0[s.name] for s in m.states])
        x0 = np.array([s.value for s in m.states]) + spread * rng.standard_normal(m.nx)
        _, y, x = self._step().mapaccum(n)(x0, u.T, w.T)
        recording = bs.from_arrays(
            dt=self.dt,
            u=u,
            y=np.array(y).T + v,
            inputs={s.name: s.unit for s in m.inputs},
            outputs={s.name: s.unit for s in m.outputs},
        )
        return recording, np.array(x).T

    def _step(self) -> ca.Function:
        """``(x, u, w) -> (x_next, y, x)`` by eight steps of a Runge-Kutta method."""
        m, fine = self.model, bs.Integrator("rk4", 8)
        x, u, w = ca.SX.sym("x", m.nx), ca.SX.sym("u", m.nu), ca.SX.sym("w", m.nx)
        end = x
        for _ in range(fine.steps):
            end = advanced(fine, m, end, ua=u, ub=u, h=self.dt / fine.steps)
        return ca.Function("step", [x, u, w], [end + w, m.output(x, u), x])


def _noise(size: float, *, channels: int = 1) -> Callable[[int, np.random.Generator], Array]:
    return lambda n, rng: size * rng.standard_normal((n, channels))


def _steps(size: float, hold: int, *, mean: float = 0.0) -> Callable[..., Array]:
    """Random levels, each held for some samples."""

    def drive(n: int, rng: np.random.Generator) -> Array:
        levels = mean + size * rng.uniform(-1, 1, n // hold + 1)
        return np.repeat(levels, hold)[:n, None]

    return drive


def _two_masses() -> bs.Model:
    return bs.Model(
        f=lambda x, u, _p: [
            x.v1,
            -200 * x.q1 - 100 * (x.q1 - x.q2) - 0.8 * x.v1 + u.F,
            x.v2,
            100 * (x.q1 - x.q2) - 0.8 * x.v2,
        ],
        h=lambda x, _u, _p: [x.q1, x.q2],
        states={"q1": "m", "v1": "m/s", "q2": "m", "v2": "m/s"},
        inputs={"F": "N"},
        outputs={"y1": "m", "y2": "m"},
        name="two masses",
    )


def _pendulum() -> bs.Model:
    return bs.Model(
        f=lambda x, u, _p: [x.rate, -9.81 / 0.5 * ca.sin(x.angle) - 0.3 * x.rate + u.M],
        h=lambda x, _u, _p: [0.5 * ca.sin(x.angle)],
        states={"angle": "rad", "rate": "rad/s"},
        inputs={"M": "1/s2"},
        outputs={"aside": "m"},
        name="pendulum",
    )


def _punch() -> bs.Model:
    """A ram on a spring that meets a sheet at q = 0.02 m."""

    def contact(q: ca.SX) -> ca.SX:
        return 5e-4 * ca.log(1 + ca.exp((q - 0.02) / 5e-4))

    return bs.Model(
        f=lambda x, u, _p: [x.v, -400 * x.q - 4 * x.v - 2e4 * contact(x.q) + u.F],
        h=lambda x, _u, _p: [x.q],
        states={"q": "m", "v": "m/s"},
        inputs={"F": "N/kg"},
        outputs={"y": "m"},
        name="punch",
    )


def _stage() -> bs.Model:
    """A stage whose stiffness and gain walk."""
    plain = bs.Model(
        f=lambda x, u, p: [x.v, -p.k * x.q - 77.0 * x.v + p.c * u.V],
        h=lambda x, _u, _p: [x.q],
        states={"q": "um", "v": "um/s"},
        inputs={"V": "V"},
        outputs={"y": "um"},
        parameters={"k": (7e6, "1/s2"), "c": (5.4e5, "um/s2/V")},
        name="nanopositioner",
    )
    return bs.augment(plain, ["k", "c"])


def _beam() -> bs.Model:
    x = np.linspace(0.2, 1.0, 3)
    shapes = np.array([np.sin(np.pi * (i + 0.5) * x) for i in range(3)])
    sensors = {f"y{j + 1}": ("displacement", shapes[:, j]) for j in range(3)}
    return bs.modal(
        [4.0, 13.0, 27.0], damping=0.01, sensors=sensors, inputs={"F": shapes[:, 1]}, name="beam"
    )


def _tanks() -> bs.Model:
    """Two tanks one above the other; the upper one overflows into the lower one at 10."""

    def root(level: ca.SX) -> ca.SX:
        return ca.sqrt(ca.fmax(level, 0) + 1e-3)

    def over(level: ca.SX) -> ca.SX:
        return 0.5 * ca.log(1 + ca.exp((level - 10) / 0.25)) * 0.25

    return bs.Model(
        f=lambda x, u, _p: [
            -0.25 * root(x.upper) + 0.25 * u.pump - over(x.upper),
            0.25 * root(x.upper) + over(x.upper) - 0.3 * root(x.lower),
        ],
        h=lambda x, _u, _p: [x.lower],
        states={"upper": bs.Signal(value=5.0), "lower": bs.Signal(value=5.0)},
        inputs={"pump": "V"},
        outputs={"level": "1"},
        name="cascaded tanks",
    )


def _quarter_car() -> bs.Model:
    """Body and wheel on a road that walks; travel of the suspension and two accelerations."""

    def forces(x: bs.Model) -> tuple[ca.SX, ca.SX]:
        suspension = 60.0 * (x.wheel - x.body) + 4.0 * (x.v_wheel - x.v_body)
        return suspension, 4000.0 * (x.road - x.wheel) - 8.0 * suspension

    return bs.Model(
        f=lambda x, u, _p: [x.v_body, forces(x)[0] + u.F, x.v_wheel, forces(x)[1] - 8 * u.F, 0],
        h=lambda x, u, _p: [x.body - x.wheel, forces(x)[0] + u.F, forces(x)[1] - 8 * u.F],
        states={"body": "m", "v_body": "m/s", "wheel": "m", "v_wheel": "m/s", "road": "m"},
        inputs={"F": "N/kg"},
        outputs={"travel": "m", "a_body": "m/s2", "a_wheel": "m/s2"},
        name="quarter car",
    )


MACHINES = (
    Machine("linear oscillator", bs.sdof(k=100.0, b=0.5), 0.01, 3000,
            {"y": 1e-3}, {"v": 1e-2}, {"q": 0.01, "v": 0.1}, _noise(1.0)),
    Machine("two masses", _two_masses(), 0.01, 3000, {"y1": 1e-3, "y2": 2e-3},
            {"v1": 1e-2, "v2": 5e-3}, {"q1": 0.01, "v1": 0.1, "q2": 0.01, "v2": 0.1}, _noise(1.0)),
    Machine("pendulum", _pendulum(), 0.02, 3000, {"aside": 2e-3}, {"rate": 0.03},
            {"angle": 0.3, "rate": 0.3}, _steps(10.0, 20)),
    Machine("Duffing", bs.duffing(k1=100.0, d=0.5, k3=5e3), 0.01, 3000, {"y": 1e-3},
            {"v": 2e-2}, {"q": 0.02, "v": 0.1}, _steps(10.0, 15)),
    Machine("friction drive", bs.friction_drive(M=95.0, Fv=200.0, Fc=20.0, vs=5e-3), 0.005, 3000,
            {"y": 1e-5}, {"v": 1e-4}, {"q": 1e-3, "v": 1e-2}, _steps(60.0, 80)),
    Machine("punch", _punch(), 0.002, 4000, {"y": 2e-5}, {"v": 2e-3},
            {"q": 1e-3, "v": 1e-2}, _steps(14.0, 60, mean=6.0)),
    Machine("nanopositioner", _stage(), 1e-4, 80_000, {"y": 1e-3},
            {"v": 30.0, "k": 1e4}, {"q": 0.05, "v": 100.0, "k": 2e5, "c": 2e4}, _steps(1.5, 5)),
    Machine("beam, random forces", _beam(), 0.004, 3000,
            {"y1": 1e-4, "y2": 1e-4, "y3": 1e-4},
            {"q1_dot": 3e-3, "q2_dot": 3e-3, "q3_dot": 3e-3},
            {"q1": 1e-2, "q2": 1e-2, "q3": 1e-2, "q1_dot": 0.1, "q2_dot": 0.1, "q3_dot": 0.1},
            _noise(1.0)),
    Machine("cascaded tanks", _tanks(), 1.0, 20_000, {"level": 0.02},
            {"upper": 0.03, "lower": 0.03}, {"upper": 0.5, "lower": 0.5},
            _steps(2.0, 40, mean=2.8)),
    Machine("quarter car", _quarter_car(), 0.005, 20_000,
            {"travel": 1e-3, "a_body": 0.05, "a_wheel": 0.5}, {"road": 2e-3},
            {"body": 0.01, "v_body": 0.1, "wheel": 0.01, "v_wheel": 0.1, "road": 0.01},
            _noise(0.3)),
)  # fmt: skip

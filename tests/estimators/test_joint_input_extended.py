"""Unknown forces and unknown parameters together: the joint filter on a linearisation."""

import numpy as np
import pytest

import backsight as bs
from backsight.discrete import steps
from backsight.errors import TuningError
from backsight.estimators import JointInput, Noise, Prior
from closeness import assert_close
from relations.linear import Run

DT, N = 0.01, 600


def plant(kind: str, bend=lambda q: q) -> bs.Model:
    """Two masses; a force at the second, of which nothing is known."""
    seen = {
        "acceleration": lambda x, u, p: [
            x.q, (p.F - p.k * (x.q2 - x.q) - 0.8 * x.w) / 2, x.q2
        ],
        "displacement": lambda x, u, p: [x.q, x.q2],
    }[kind]  # fmt: skip
    return bs.Model(
        f=lambda x, u, p: [
            x.v,
            -300 * bend(x.q) + p.k * (x.q2 - x.q) - 0.8 * x.v + u.G,
            x.w,
            (p.F - p.k * (x.q2 - x.q) - 0.8 * x.w) / 2,
        ],
        h=seen,
        states={"q": "m", "v": "m/s", "q2": "m", "w": "m/s"},
        inputs={"G": "N"},
        outputs=dict.fromkeys(["y", "a", "y2"] if kind == "acceleration" else ["y", "y2"], ""),
        parameters={"k": (700.0, "N/m"), "F": (0.0, "N")},
    )


def recorded(model: bs.Model, sigma, k: float = 700.0, seed: int = 0):
    rng = np.random.default_rng(seed)
    force = np.repeat(rng.standard_normal(N // 5), 5) * 20
    u = np.repeat(rng.standard_normal(N // 20), 20)[:, None] * 10
    moved = bs.forces.forces_as_inputs(model, ["F"])
    made = bs.simulate(
        moved, np.hstack([u, force[:, None]]), dt=DT, parameters={"k": k}, sigma_y=sigma,
        seed=seed, substeps=4,
    )  # fmt: skip
    return u, made["y"].values, force


@pytest.mark.parametrize("kind", ["acceleration", "displacement"])
def test_a_linear_model_in_disguise_gives_what_the_linear_filter_gives(kind, monkeypatch):
    """A cube that is too small to matter; Runge-Kutta beside the matrix exponential."""
    monkeypatch.setattr(steps, "ACCURATE", 1e-9)
    sigma = [1e-4, 0.05, 1e-4] if kind == "acceleration" else [1e-4, 1e-4]
    straight, curved = plant(kind), plant(kind, lambda q: q + 1e-30 * q**3)
    u, y, _ = recorded(straight, sigma)
    y[50, 0] = y[90] = np.nan
    noise = Noise(sigma_y=sigma, sigma_w=[0, 1e-3, 0, 1e-3])
    e = JointInput(noise, Prior(sigma_x0=[1e-2, 0.1, 1e-2, 0.1]), forces=("F",))
    a, b = (Run(e, m, DT)(u[:150], y[:150]) for m in (straight, curved))
    for name in ("x_hat", "d_hat", "P", "P_d"):
        assert_close(b[name], a[name], 1e-5)


@pytest.mark.parametrize("kind", ["acceleration", "displacement"])
def test_force_and_stiffness_are_found_together(kind):
    sigma = [1e-5, 0.02, 1e-5] if kind == "acceleration" else [1e-5, 1e-5]
    model = plant(kind)
    u, y, force = recorded(model, sigma, k=770.0)
    joint = bs.augment(model, ["k"])
    noise = Noise(sigma_y=sigma, sigma_w={"v": 1e-4, "w": 1e-4})
    prior = Prior(sigma_x0={"q": 1e-3, "v": 1e-2, "q2": 1e-3, "w": 1e-2, "k": 100.0})
    result = Run(JointInput(noise, prior, forces=("F",)), joint, DT)(u, y)
    k, std = result["x_hat"][-1, 4], np.sqrt(result["P"][-1, 4, 4])
    assert abs(k - 770) < 3 * std < 15
    ago = 0 if kind == "acceleration" else 1
    found, band = result["d_hat"][100:, 0], np.sqrt(result["P_d"][100:, 0, 0])
    error = (found - force[100 - ago : N - ago]) / band
    assert 0.8 < np.sqrt(np.mean(error**2)) < 1.25
    assert np.all(result["status"] == 0)


def test_what_cannot_be_is_refused():
    joint = bs.augment(plant("displacement"), ["k"])
    noise, prior = Noise(sigma_y=1e-4, sigma_w=1e-4), Prior(sigma_x0=1.0)
    with pytest.raises(TuningError, match="hold = 'zoh'"):
        JointInput(noise, prior, forces=("F",), hold="foh").compile(joint, DT)
    with pytest.raises(TuningError, match="smooths linear models only"):
        JointInput(noise, prior, forces=("F",)).smoother(joint, DT, covariance="std")

"""Orders of a shaft and pressures over an area from problem files, made by another route."""

import functools

import numpy as np
import pytest
from scipy.linalg import expm

import backsight as bs
from backsight.problem import load, run_problem
from backsight.problem.recorded import recording_of


@functools.cache
def shaft():
    """A rotor that runs up, and the first and second order of the force that turns with it."""
    dt, n, fine = 0.005, 400, 20
    t = dt / fine * np.arange(n * fine)
    hertz = 6 + 2 * t
    angle = 2 * np.pi * (6 * t + t**2)
    force = 3 * np.cos(angle) + 1.2 * np.sin(2 * angle)
    A, B = np.array([[0, 1], [-3600.0, -6.0]]), np.array([[0.0], [1.0]])
    grown = expm(dt / fine * np.block([[A, B], [np.zeros((1, 3))]]))
    x, y = np.zeros(2), []
    for k, push in enumerate(force):
        if k % fine == 0:
            y.append(x[1])
        x = grown[:2, :2] @ x + grown[:2, 2] * push
    noise = 3e-4 * np.random.default_rng(2).standard_normal(n)
    return np.array(y) + noise, hertz[::fine], force[::fine]


ROTOR = """
[recording]
path = "run_up.csv"
dt = 0.005
inputs.n = { column = "n", unit = "Hz" }
outputs.y = { column = "y", unit = "m/s" }

[model]
kind = "equations"
states = { q = "m", v = "m/s" }
parameters = { F = { value = 0.0, unit = "N" } }
equations = { q = "v", v = "F - 3600*q - 6*v" }
outputs = { y = "v" }

[forces.F]
kind = "periodic"
sigma = 3.0
frequency = "n"
orders = [1.0, 2.0]
memory = 20.0

[prior]
sigma_x0 = { q = 1e-4, v = 1e-4 }

[noise]
sigma_y = { y = 3e-4 }

[estimators.kf]
kind = "kf"
hold = "foh"
"""


def test_orders_of_a_shaft(tmp_path):
    """The force, and each order by itself, through a resonance, in bands that cover."""
    y, hertz, force = shaft()
    rows = np.column_stack([hertz, y])
    np.savetxt(tmp_path / "run_up.csv", rows, delimiter=",", header="n,y", comments="")
    (tmp_path / "problem.toml").write_text(ROTOR)
    made = load(tmp_path / "problem.toml")
    found = bs.estimate(made.estimators["kf"], made.model, recording_of(made), engine="vm")
    late = slice(250, None)
    off = (found["x_hat"].sel(state="F").values - force)[late]
    std = found["x_std"].sel(state="F").values[late]
    assert np.sqrt((off**2).mean()) < 0.03 * np.sqrt((force**2).mean())
    assert (np.abs(off) < 4 * std).all()
    second = found["x_hat"].sel(state=["F_order2", "F_order2_quadrature"]).values[late]
    assert np.hypot(*second.T).mean() == pytest.approx(1.2, rel=0.03)


CELLS, AREA, GUST = 9, 0.04, (20, 5, 1500.0)
"""Of a membrane, area of a cell [m2]; first sample, samples and height of a gust [Pa]."""

MEMBRANE = """
[recording]
path = "y.csv"
dt = 0.004
outputs = {{ a = "a", b = "b", c = "c" }}

[model]
kind = "reduced"
mass = {mass}
stiffness = {stiffness}
coordinates = {names}
modes = 6
damping = 0.02
sensors.a = {{ kind = "displacement", at = "z2" }}
sensors.b = {{ kind = "displacement", at = "z5" }}
sensors.c = {{ kind = "displacement", at = "z8" }}
forces.left = {{ z1 = {area}, z2 = {area}, z3 = {area} }}
forces.middle = {{ z4 = {area}, z5 = {area}, z6 = {area} }}
forces.right = {{ z7 = {area}, z8 = {area}, z9 = {area} }}

[prior]
P0 = {prior}

[noise]
sigma_y = {{ a = 1e-6, b = 1e-6, c = 1e-6 }}

[estimators.CS]
kind = "csmhe"
forces = ["left", "middle", "right"]
lam = 1.0
search = {{}}
"""


@pytest.mark.slow
def test_pressure_over_an_area(tmp_path):
    """A gust on a third of a membrane: which, when, and how many pascals."""
    M = 0.5 * np.eye(CELLS)
    K = 4e3 * (2 * np.eye(CELLS) - np.eye(CELLS, k=1) - np.eye(CELLS, k=-1))
    w2, V = np.linalg.eigh(K / 0.5)
    w, V = np.sqrt(w2[:6]), V[:, :6] / np.sqrt(0.5)
    A = np.block([[np.zeros((6, 6)), np.eye(6)], [-np.diag(w**2), -0.04 * np.diag(w)]])
    B = np.vstack([np.zeros((6, 1)), V[3:6].sum(axis=0)[:, None] * AREA])
    grown = expm(0.004 * np.block([[A, B], [np.zeros((1, 13))]]))
    x, y = np.zeros(12), []
    first, long, pascals = GUST
    for k in range(60):
        y.append(V[[1, 4, 7]] @ x[:6])
        pressure = pascals * (first <= k < first + long)
        x = grown[:12, :12] @ x + grown[:12, 12] * pressure
    y = np.array(y) + 1e-6 * np.random.default_rng(4).standard_normal((60, 3))
    np.savetxt(tmp_path / "y.csv", y, delimiter=",", header="a,b,c", comments="")
    prior = np.diag([1e-10] * 6 + [1e-8] * 6).tolist()
    names = [f"z{i + 1}" for i in range(CELLS)]
    (tmp_path / "p.toml").write_text(
        MEMBRANE.format(mass=M.tolist(), stiffness=K.tolist(), names=names, area=AREA, prior=prior)
    )
    made = load(tmp_path / "p.toml")
    found = run_problem(made, tmp_path / "out", progress=lambda *_: None)["CS"]
    d = found["d_hat"].values
    assert np.flatnonzero(d.any(axis=0)).tolist() == [1]
    assert np.flatnonzero(d[:, 1]).tolist() == list(range(first, first + long))
    assert d[first : first + long, 1].mean() == pytest.approx(pascals, rel=0.05)

"""Every kind of force from a problem file, on a bridge that is moved by another route."""

import dataclasses
import functools
from collections.abc import Callable

import numpy as np
import pytest
from scipy.linalg import expm

from backsight.problem import load, run_problem

LENGTH, MASS, EI, DAMPING, DT, FINE = 20.0, 3000.0, 4e9, 0.02, 0.01, 16
SENSORS = {"a": ("acceleration", 5.0), "b": ("acceleration", 14.0), "w": ("displacement", 10.0)}
PLACES = (2.5, 5.0, 7.5, 10.0, 12.5, 15.0, 17.5)
LINE = f"{{ places = {list(PLACES)}, supports = [0.0, {LENGTH}] }}"
MODES = np.arange(1, 4)
OMEGA = (MODES * np.pi / LENGTH) ** 2 * np.sqrt(EI / MASS)


def shape(x):
    """Mass-normalised shapes of the bridge, sines."""
    return np.sqrt(2 / (MASS * LENGTH)) * np.sin(MODES * np.pi * x / LENGTH)


@dataclasses.dataclass(frozen=True)
class Made:
    """What acts: a force [N] at a place [m], both by time [samples]; and the dictionary for it."""

    dictionary: str
    force: Callable[[float], float]
    place: Callable[[float], float]
    samples: int = 80


def pulse(start, width, size, course):
    """A course over time that begins at a sample."""

    def force(t):
        s = (t - start) / width
        return size * course(s) if s > 0 else 0.0

    return force


def bump(s):
    """Cubic B-spline over s from 0 to 1."""
    x = 4 * abs(min(s, 1.0) - 0.5)
    return (2 / 3 - x**2 + x**3 / 2 if x < 1 else max(2 - x, 0.0) ** 3 / 6) * 1.5


CASES = {
    "half-sine": (
        Made(
            'kind = "HalfSines", widths = [3, 5, 8]',
            pulse(20.3, 4.6, 9e3, lambda s: np.sin(np.pi * s) * (s < 1)),
            lambda _: 8.2,
        ),
        {"place": 8.2, "start": 20.3, "width": 4.6, "size": 9e3},
    ),
    "haversine": (
        Made(
            'kind = "Haversines", widths = [4, 8]',
            pulse(18.4, 6.5, -8e3, lambda s: np.sin(np.pi * s) ** 2 * (s < 1)),
            lambda _: 12.9,
        ),
        {"place": 12.9, "start": 18.4, "width": 6.5, "size": -8e3},
    ),
    "decay": (
        Made(
            'kind = "Decays", widths = [2, 4, 6]',
            pulse(15.6, 3.3, 9e3, lambda s: np.exp(-s) * (s < 6)),
            lambda _: 6.1,
        ),
        {"place": 6.1, "start": 15.6, "width": 3.3, "size": 9e3},
    ),
    "step": (
        Made(
            'kind = "SteadyLoads", length = 80', pulse(22.7, 1, 6e3, lambda _: 1.0), lambda _: 13.4
        ),
        {"place": 13.4, "start": 22.7, "size": 6e3},
    ),
    "spline": (
        Made('kind = "Splines", widths = [8, 12]', pulse(12.2, 10.4, 7e3, bump), lambda _: 9.3),
        {"place": 9.3, "start": 12.2, "width": 10.4, "size": 7e3},
    ),
    "moving": (
        Made(
            f'kind = "MovingLoads", line = {LINE}, crossings = [90, 110, -110]',
            pulse(12.4, 103.7, -12e3, lambda s: float(s < 1)),
            lambda t: LENGTH * np.clip((t - 12.4) / 103.7, 0, 1),
            samples=140,
        ),
        {"speed": LENGTH / (103.7 * DT), "start": 12.4, "size": -12e3},
    ),
}


@functools.cache
def motion():
    """One part of a sample of all modes, and what a held modal force does in it."""
    A = np.block(
        [[np.zeros((3, 3)), np.eye(3)], [-np.diag(OMEGA**2), -2 * DAMPING * np.diag(OMEGA)]]
    )
    B = np.vstack([np.zeros((3, 3)), np.eye(3)])
    return A, expm(DT / FINE * np.block([[A, B], [np.zeros((3, 9))]]))


def readings(made):
    """Outputs (samples, 3), and the noise of 20 dB that is put on the accelerometers."""
    A, grown = motion()
    x, rows = np.zeros(6), []
    seen = [shape(at) for _, at in SENSORS.values()]
    for k in range(made.samples):
        now = made.force(k) * shape(made.place(k))
        rate = A[3:] @ x + now
        rows.append([seen[0] @ rate, seen[1] @ rate, seen[2] @ x[:3]])
        for i in range(FINE):
            t = k + (i + 0.5) / FINE
            x = grown[:6, :6] @ x + grown[:6, 6:] @ (made.force(t) * shape(made.place(t)))
    y = np.array(rows)
    sigma = 0.1 * y.std(axis=0)
    return y + sigma * np.random.default_rng(5).standard_normal(y.shape), sigma


def problem(made, folder):
    """The bridge, and what is looked for."""
    y, sigma = readings(made)
    np.savetxt(folder / "y.csv", y, delimiter=",", header="a,b,w", comments="")
    sensors = "\n".join(
        f'sensors.{n} = {{ kind = "{k}", at = {at} }}' for n, (k, at) in SENSORS.items()
    )
    names = [f"P{i}" for i in range(len(PLACES))]
    path = folder / "problem.toml"
    path.write_text(f"""
[recording]
path = "y.csv"
dt = {DT}
outputs = {{ a = "a", b = "b", w = "w" }}

[model]
kind = "beam"
length = {LENGTH}
boundary = "pinned-pinned"
bending_stiffness = {EI}
mass_per_length = {MASS}
damping = {DAMPING}
{sensors}
forces = {{ {", ".join(f"{n} = {x}" for n, x in zip(names, PLACES, strict=True))} }}

[prior]
sigma_x0 = {{ q1 = 1e-3, q2 = 1e-3, q3 = 1e-3, q1_dot = 1e-3, q2_dot = 1e-3, q3_dot = 1e-3 }}

[noise]
sigma_y = {{ a = {sigma[0]}, b = {sigma[1]}, w = {sigma[2]} }}

[estimators.CS]
kind = "csmhe"
forces = {names}
lam = 1.0
sigma_force = 20.0
dictionary = {{ {made.dictionary} }}

[estimators.CS.search]
locate = true
line = {LINE}
""")
    return load(path)


def located(made, folder):
    """The one hit that is found, by names."""
    found = run_problem(problem(made, folder), folder / "out", progress=lambda *_: None)["CS"]
    assert found.sizes["hit"] == 1
    columns = (name for name in found.data_vars if str(name).startswith("hit_"))
    return {str(name)[4:]: float(found[name][0]) for name in columns}


def assert_found(hit, true):
    """Speed within 2 %, size within 5 %, place and time as sure as it says."""
    for name, value in true.items():
        value = DT * value if name in ("start", "width") else value
        assert abs(hit[name] - value) < 4 * hit[f"{name}_std"], name
    assert hit["size"] == pytest.approx(true["size"], rel=0.05)
    if "speed" in true:
        assert hit["speed"] == pytest.approx(true["speed"], rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_a_force_of_every_kind(case, tmp_path):
    made, true = CASES[case]
    assert_found(located(made, tmp_path), true)

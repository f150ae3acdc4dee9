"""A problem file with its recording, small enough to be solved in a moment."""

from pathlib import Path

import numpy as np

SAMPLES, DT = 200, 0.01
STIFFNESS, DAMPING = 100.0, 2.0

TEXT = """\
title = "Mass on a spring"

[recording]
path = "spring.csv"
time = "t"
inputs.u = { column = "force", unit = "N" }
outputs.y = { column = "place", unit = "m" }

[model]
kind = "sdof"
c = 1.0

[estimate]
k = { start = 80.0, sigma = 30.0 }
b = { start = 1.0, sigma = 1.0 }

[prior]
sigma_x0 = { q = 0.01, v = 0.1 }

[noise]
sigma_y = { y = 1e-4 }

[estimators.EKF]
kind = "ekf"

[estimators.MHO]
kind = "mho"
N = 5

[reference]
k = 100.0
b = 2.0
"""


def table() -> np.ndarray:
    """Columns t, force, place of a damped oscillator at rest under a held force: exact steps."""
    rng = np.random.default_rng(1)
    force = np.repeat(rng.choice([-5.0, 5.0], SAMPLES // 10), 10)
    roots = np.roots([1.0, DAMPING, STIFFNESS])
    modes = np.array([[1.0, 1.0], roots])
    step = ((modes * np.exp(roots * DT)) @ np.linalg.inv(modes)).real
    state, place = np.zeros(2), []
    for f in force:
        place.append(state[0])
        rest = np.array([f / STIFFNESS, 0.0])
        state = rest + step @ (state - rest)
    noise = 1e-4 * rng.standard_normal(SAMPLES)
    return np.column_stack([DT * np.arange(SAMPLES), force, np.array(place) + noise])


def write(folder: Path, text: str = TEXT) -> Path:
    """Write recording and problem file; return the path of the latter."""
    lines = ["t,force,place", *(",".join(map(repr, row)) for row in table().tolist())]
    (folder / "spring.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    path = folder / "problem.toml"
    path.write_text(text, encoding="utf-8")
    return path


def changed(old: str, new: str) -> str:
    """The problem file with one passage replaced."""
    assert TEXT.count(old) == 1, f"{old!r} is there {TEXT.count(old)} times"
    return TEXT.replace(old, new)

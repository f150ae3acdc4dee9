"""A small fleet: springs whose recordings are written in a moment."""

from pathlib import Path

import numpy as np

PROBLEM = """\
[recording]
path = "none.csv"
time = "t"
inputs.u = { column = "force", unit = "N" }
outputs.y = { column = "place", unit = "m" }

[model]
kind = "sdof"
k = 40.0
b = 1.0

[noise]
sigma_y = { y = 1e-3 }

[prior]
sigma_x0 = { q = 0.1, v = 0.1 }

[estimators.KF]
kind = "kf"
"""

FLEET = """\
title = "Springs"
problem = "spring.toml"
recordings.files = "runs/*.csv"
"""


def write_recording(path: Path, seed: int, *, samples: int = 40, dt: float = 0.05) -> Path:
    """A spring that is pushed; its places are noise around a curve."""
    rng = np.random.default_rng(seed)
    t = dt * np.arange(samples)
    force = rng.standard_normal(samples)
    place = 0.02 * np.sin(2 * t) + 1e-3 * rng.standard_normal(samples)
    rows = [",".join(map(repr, row)) for row in np.column_stack([t, force, place]).tolist()]
    path.parent.mkdir(exist_ok=True)
    path.write_text("\n".join(["t,force,place", *rows]) + "\n", encoding="utf-8")
    return path


def write_fleet(folder: Path, *, count: int = 3, more: str = "", fleet: str = FLEET) -> Path:
    """Problem, recordings and fleet file; `more` is put behind the latter."""
    for k in range(count):
        write_recording(folder / "runs" / f"r{k}.csv", k)
    (folder / "spring.toml").write_text(PROBLEM, encoding="utf-8")
    path = folder / "fleet.toml"
    path.write_text(fleet + more, encoding="utf-8")
    return path

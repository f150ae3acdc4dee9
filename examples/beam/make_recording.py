"""Make the recording `beam.csv` beside this file: six hits on a cantilever beam."""

import io
from pathlib import Path

import numpy as np
import xarray as xr

import backsight as bs

DT, SAMPLES, NOISE, SEED = 1 / 400, 400, 2e-6, 1
PLACES = {f"F{i + 1}": 0.125 + 0.04 * i for i in range(8)}
SENSORS = {"y1": 0.245, "y2": 0.325, "y3": 0.405}
HITS = {
    40: ("F8", -10.0),
    88: ("F7", -5.0),
    151: ("F5", 5.0),
    210: ("F2", 10.0),
    262: ("F3", -8.0),
    300: ("F8", 4.0),
}
"""Sample to place and force [N], which acts until the next sample."""

HEADER = f"""\
Simulated recording of a cantilever beam at {1 / DT:g} Hz, by make_recording.py (seed {SEED}).
y1_m, y2_m, y3_m: its deflections at {", ".join(f"{x:g}" for x in SENSORS.values())} m from the
clamp, with noise of {1e6 * NOISE:g} um. Hits of {1e3 * DT:g} ms, which no estimator knows:
{", ".join(f"{force:g} N on {name} at {k * DT:g} s" for k, (name, force) in HITS.items())}.
Beam and places after Kirchner, Croes, Cosco, Desmet: Exploiting input sparsity for joint
state/input moving horizon estimation, Mechanical Systems and Signal Processing 101, 2018."""


def cantilever() -> bs.Model:
    """The beam with a force at every place where a hit is possible."""
    return bs.beam(
        0.405,
        width=0.025,
        thickness=0.003,
        youngs_modulus=65.9e9,
        density=7502.0,
        modes=3,
        damping=[0.030, 0.037, 0.119],
        sensors={name: ("displacement", place) for name, place in SENSORS.items()},
        forces=PLACES,
    )


def simulated() -> xr.Dataset:
    """The recording with its hits as inputs."""
    hits = np.zeros((SAMPLES, len(PLACES)))
    for k, (name, force) in HITS.items():
        hits[k, list(PLACES).index(name)] = force
    known = bs.forces.forces_as_inputs(cantilever(), list(PLACES))
    return bs.simulate(known, hits, dt=DT, sigma_y=NOISE, seed=SEED)


def recording_text() -> str:
    """The whole file as text."""
    made = simulated()
    lines = io.StringIO()
    table = np.column_stack([made["time"], made["y"]])
    np.savetxt(lines, table, delimiter=",", fmt=["%.4f", *["%.9g"] * len(SENSORS)])
    comments = "".join(f"# {line}\n" for line in HEADER.splitlines())
    columns = ",".join(["t_s", *(f"{name}_m" for name in SENSORS)])
    return f"{comments}{columns}\n{lines.getvalue()}"


if __name__ == "__main__":
    place = Path(__file__).with_name("beam.csv")
    place.write_text(recording_text(), encoding="utf-8", newline="\n")
    print(f"wrote {place}")

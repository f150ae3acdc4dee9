"""Make `run_up.csv` beside this file: a rotor runs up through its critical speeds."""

import io
from pathlib import Path

import numpy as np
import xarray as xr

import backsight as bs

DT, SAMPLES, SEED = 2e-3, 2500, 4
MASS = 12.0  # kg
TRUE = {"kx": 2.2e5, "ky": 1.7e5, "d": 60.0, "ex": 35e-6, "ey": -20e-6}  # N/m, N s/m, m
SPEED_UP = 40.0  # rad/s2
SIGMA = 2e-6  # noise of the proximity probes [m]
SIGMA_ROUGH = 2e-5  # what flow and bearings add to the speeds from sample to sample [m/s]
HEADER = f"""\
Simulated run-up at {1 / DT:g} Hz, by make_recording.py (seed {SEED}): angle and speed of the shaft,
which gains {SPEED_UP:g} rad/s in a second, and its displacement in two directions, with noise of
{1e6 * SIGMA:g} um. Rotor of {MASS:g} kg. True values, which no estimator knows: bearings
{TRUE["kx"]:g} and {TRUE["ky"]:g} N/m, damping {TRUE["d"]:g} N s/m, and a centre
of mass off the axis by {1e6 * TRUE["ex"]:g} and {1e6 * TRUE["ey"]:g} um."""


def rotor() -> bs.Model:
    """A heavy disk on a shaft between bearings, of which one direction is softer."""
    pull = "w**2 * ({0}*cos(phi) - {1}*sin(phi)) + {2} * ({0}*sin(phi) + {1}*cos(phi))"
    return bs.from_equations(
        states={"x": "m", "y": "m", "vx": "m/s", "vy": "m/s"},
        inputs={"phi": "rad", "w": "rad/s", "rx": "m/s2", "ry": "m/s2"},
        outputs={"x_probe": "m", "y_probe": "m"},
        parameters={**TRUE, "m": (MASS, "kg"), "faster": (SPEED_UP, "rad/s2")},
        equations={
            "x": "vx",
            "y": "vy",
            "vx": f"-(kx*x + d*vx)/m + rx + {pull.format('ex', 'ey', 'faster')}",
            "vy": f"-(ky*y + d*vy)/m + ry + {pull.format('ey', '(-ex)', 'faster')}",
        },
        output_equations={"x_probe": "x", "y_probe": "y"},
    )


def simulated() -> xr.Dataset:
    """The recording; roughness of flow and bearings is an input that only the simulation knows."""
    rng = np.random.default_rng(SEED)
    t = DT * np.arange(SAMPLES)
    rough = SIGMA_ROUGH / DT * rng.standard_normal((SAMPLES, 2))
    u = np.column_stack([SPEED_UP * t**2 / 2.0, SPEED_UP * t, rough])
    return bs.simulate(rotor(), u, dt=DT, sigma_y=SIGMA, seed=SEED, hold="foh")


def recording_text() -> str:
    """The whole file as text."""
    made = simulated()
    lines = io.StringIO()
    table = np.column_stack([made["time"], made["u"][:, :2], 1e6 * made["y"]])
    np.savetxt(lines, table, delimiter=",", fmt=["%.3f", "%.5f", "%.3f", "%.2f", "%.2f"])
    comments = "".join(f"# {line}\n" for line in HEADER.splitlines())
    return f"{comments}t [s],angle [rad],speed [rad/s],x [um],y [um]\n{lines.getvalue()}"


if __name__ == "__main__":
    place = Path(__file__).with_name("run_up.csv")
    place.write_text(recording_text(), encoding="utf-8", newline="\n")
    print(f"wrote {place}")

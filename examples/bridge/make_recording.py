"""Make `crossing.csv` beside this file: a truck crosses a bridge."""

import io
from pathlib import Path

import numpy as np
import xarray as xr

import backsight as bs

DT, SAMPLES, SEED = 0.01, 500, 6
LENGTH, STIFFNESS, MASS = 24.0, 6.0e9, 4500.0  # m, N m2, kg/m
AXLES, BASE, SPEED, START = {"front": 55e3, "rear": 98e3}, 4.2, 14.0, 0.5  # N, m, m/s, s
PLACES = {axle: {f"{axle}{i}": 3.0 * i for i in range(1, 8)} for axle in AXLES}
SIGMA = {"third": 2e-6, "middle": 2e-6, "sag": 5e-5}  # strain gauges [1], displacement [m]
HEADER = f"""\
Simulated crossing at {1 / DT:g} Hz, by make_recording.py (seed {SEED}): where the front axle of a
truck is, by a camera; strain at a third of the bridge and at its middle with noise of
{1e6 * SIGMA["middle"]:g}e-6, and its sag in the middle with noise of {1e3 * SIGMA["sag"]:g} mm.
True axles {AXLES["front"]:g} and {AXLES["rear"]:g} N, {BASE:g} m apart, at {SPEED:g} m/s."""


def bridge() -> bs.Model:
    """A span on two bearings with two axles on it, whose places are inputs."""
    span = bs.beam(
        LENGTH,
        bending_stiffness=STIFFNESS,
        mass_per_length=MASS,
        thickness=1.4,
        boundary="pinned-pinned",
        modes=3,
        damping=0.015,
        sensors={
            "third": ("strain", LENGTH / 3),
            "middle": ("strain", LENGTH / 2),
            "sag": ("displacement", LENGTH / 2),
        },
        forces={name: at for places in PLACES.values() for name, at in places.items()},
    )
    for axle, place in (("front", "s"), ("rear", "s_rear")):
        span = bs.forces.moving_load(
            span, axle, position=place, along=PLACES[axle], supports=(0.0, LENGTH)
        )
    return span


def simulated() -> xr.Dataset:
    """The recording with the places of both axles."""
    front = SPEED * (DT * np.arange(SAMPLES) - START)
    places = np.column_stack([front, front - BASE])
    return bs.simulate(
        bridge(), places, dt=DT, parameters=AXLES, sigma_y=SIGMA, seed=SEED, hold="foh"
    )


def recording_text() -> str:
    """The whole file as text."""
    made = simulated()
    lines = io.StringIO()
    strain, sag = 1e6 * made["y"][:, :2], 1e3 * made["y"][:, 2]
    table = np.column_stack([made["time"], made["u"][:, 0], strain, sag])
    np.savetxt(lines, table, delimiter=",", fmt=["%.2f", "%.3f", "%.2f", "%.2f", "%.4f"])
    comments = "".join(f"# {line}\n" for line in HEADER.splitlines())
    return f"{comments}t_s,axle_m,third_1e-6,middle_1e-6,sag_mm\n{lines.getvalue()}"


if __name__ == "__main__":
    place = Path(__file__).with_name("crossing.csv")
    place.write_text(recording_text(), encoding="utf-8", newline="\n")
    print(f"wrote {place}")

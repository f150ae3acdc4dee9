"""Make `earthquake.csv` beside this file: five storeys on ground that shakes."""

import io
from pathlib import Path

import numpy as np
import xarray as xr
from scipy.signal import lfilter

import backsight as bs

DT, SAMPLES, SEED = 0.01, 2000, 2
MASS, STIFFNESS, DAMPING = 25e3, 3.0e7, 1.2e5  # of a storey: kg, N/m, N s/m
WEAK, LEFT = 2, 1.8e7  # number of the storey with a crack, and what is left of its stiffness [N/m]
SIGMA_A, SIGMA_G = 0.02, 0.01  # sensors on the floors and on the ground [m/s2]
FLOORS = range(1, 6)
HEADER = f"""\
Simulated earthquake at {1 / DT:g} Hz, by make_recording.py (seed {SEED}): accelerations of the
ground (noise {SIGMA_G:g} m/s2) and of the floors of five storeys (noise {SIGMA_A:g} m/s2).
Storeys of {MASS:g} kg, {STIFFNESS:g} N/m, {DAMPING:g} N s/m; storey {WEAK} has
only {LEFT:g} N/m left, which no estimator knows."""


def force(i: int) -> str:
    """Force in storey `i` on the floor above it, as a formula."""
    below = (f"q{i - 1}", f"v{i - 1}") if i > 1 else ("0", "0")
    return f"(k{i}*(q{i} - {below[0]}) + c*(v{i} - {below[1]}))" if i < 6 else "0"


def building(stiffness: float) -> bs.Model:
    """Floors relative to the ground; what accelerometers measure is absolute."""
    floors = {i: f"({force(i + 1)} - {force(i)}) / m" for i in FLOORS}
    return bs.from_equations(
        states={f"q{i}": "m" for i in FLOORS} | {f"v{i}": "m/s" for i in FLOORS},
        inputs={"ground": "m/s2"},
        outputs={f"a{i}": "m/s2" for i in FLOORS},
        parameters={"m": (MASS, "kg"), "c": (DAMPING, "N s/m")}
        | {f"k{i}": (stiffness, "N/m") for i in FLOORS},
        equations={f"q{i}": f"v{i}" for i in FLOORS}
        | {f"v{i}": f"{acceleration} - ground" for i, acceleration in floors.items()},
        output_equations={f"a{i}": acceleration for i, acceleration in floors.items()},
    )


def simulated() -> xr.Dataset:
    """The recording; the ground is measured with noise."""
    rng = np.random.default_rng(SEED)
    t = DT * np.arange(SAMPLES)
    strong = np.minimum(1.0, t / 2.0) * np.exp(-np.maximum(t - 8.0, 0.0) / 4.0)
    ring = np.exp(-0.4 * 15.0 * DT)  # soil that answers at 15 rad/s with a damping ratio of 0.4
    poles = [1.0, -2.0 * ring * np.cos(15.0 * DT), ring**2]
    ground = strong * lfilter([0.25, -0.25], poles, rng.standard_normal(SAMPLES))
    model = building(STIFFNESS)
    made = bs.simulate(
        model, ground[:, None], dt=DT, parameters={f"k{WEAK}": LEFT}, sigma_y=SIGMA_A, seed=SEED
    )
    made["u"] = made["u"] + SIGMA_G * rng.standard_normal(made["u"].shape)
    return made


def recording_text() -> str:
    """The whole file as text."""
    made = simulated()
    lines = io.StringIO()
    table = np.column_stack([made["time"], made["u"], made["y"]])
    np.savetxt(lines, table, delimiter=",", fmt=["%.2f", *["%.4f"] * 6])
    comments = "".join(f"# {line}\n" for line in HEADER.splitlines())
    floors = ",".join(f"floor {i} [m/s2]" for i in FLOORS)
    return f"{comments}t [s],ground [m/s2],{floors}\n{lines.getvalue()}"


if __name__ == "__main__":
    place = Path(__file__).with_name("earthquake.csv")
    place.write_text(recording_text(), encoding="utf-8", newline="\n")
    print(f"wrote {place}")

"""Make `ride.csv` beside this file: a quarter of a car on a rough road."""

import io
from pathlib import Path

import numpy as np
import xarray as xr

import backsight as bs

DT, SAMPLES, SEED = 2e-3, 6000, 5
BODY, WHEEL, TYRE = 320.0, 40.0, 2.0e5  # kg, kg, N/m
TRUE = {"ks": 1.8e4, "cs": 1.4e3}  # suspension: N/m, N s/m
SIGMA = {"body": 0.05, "wheel": 0.2, "travel": 1e-3}  # m/s2, m/s2, m
ROUGH = 3e-4  # height that the road gains from sample to sample [m]
HEADER = f"""\
Simulated ride at {1 / DT:g} Hz, by make_recording.py (seed {SEED}): accelerations of body and
wheel, and the travel of the suspension. The road, which nobody measures, is a random walk
({1e3 * ROUGH:g} mm from sample to sample).
True suspension: {TRUE["ks"]:g} N/m, {TRUE["cs"]:g} N s/m;
body {BODY:g} kg, wheel {WHEEL:g} kg, tyre {TYRE:g} N/m."""


def car() -> bs.Model:
    """Body and wheel above a road that is a known input: only the simulation knows it."""
    spring = "(ks*(zw - zb) + cs*(vw - vb))"
    body, wheel = f"{spring} / mb", f"(kt*(road - zw) - {spring}) / mw"
    return bs.from_equations(
        states={"zb": "m", "zw": "m", "vb": "m/s", "vw": "m/s"},
        inputs={"road": "m"},
        outputs={"body": "m/s2", "wheel": "m/s2", "travel": "m"},
        parameters={**TRUE, "mb": BODY, "mw": WHEEL, "kt": TYRE},
        equations={"zb": "vb", "zw": "vw", "vb": body, "vw": wheel},
        output_equations={"body": body, "wheel": wheel, "travel": "zw - zb"},
    )


def simulated() -> xr.Dataset:
    """The recording, with the road as its input."""
    rng = np.random.default_rng(SEED)
    road = np.cumsum(ROUGH * rng.standard_normal(SAMPLES))
    return bs.simulate(car(), road[:, None], dt=DT, sigma_y=SIGMA, seed=SEED)


def recording_text() -> str:
    """The whole file as text."""
    made = simulated()
    lines = io.StringIO()
    np.savetxt(
        lines,
        np.column_stack([made["time"], made["y"]]),
        delimiter=",",
        fmt=["%.3f", *["%.5f"] * 3],
    )
    comments = "".join(f"# {line}\n" for line in HEADER.splitlines())
    return f"{comments}t [s],body [m/s2],wheel [m/s2],travel [m]\n{lines.getvalue()}"


if __name__ == "__main__":
    place = Path(__file__).with_name("ride.csv")
    place.write_text(recording_text(), encoding="utf-8", newline="\n")
    print(f"wrote {place}")

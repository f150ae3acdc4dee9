"""Make `motor.csv` and `motor_german.csv` beside this file: a motor turns a mill."""

import io
from pathlib import Path

import numpy as np
import xarray as xr

import backsight as bs

DT, SAMPLES, SEED = 1e-3, 4000, 3
SIGMA_Y, SIGMA_LOAD = 0.05, 2e-4
TRUE = {"J": 2.4e-3, "b": 1.5e-3, "kt": 0.11}
HEADER = f"""\
Simulated motor at {1 / DT:g} Hz, by make_recording.py (seed {SEED}): current through the
motor, and its speed with noise of {SIGMA_Y:g} rad/s. It drives a mill whose load wanders
({SIGMA_LOAD:g} Nm from sample to sample).
True inertia {TRUE["J"]:g} kg m2, viscous friction {TRUE["b"]:g} Nm s/rad,
torque constant {TRUE["kt"]:g} Nm/A."""


def motor() -> bs.Model:
    """Motor with a load that is a known input: only the simulation knows it."""
    return bs.from_equations(
        states={"w": "rad/s"},
        inputs={"i": "A", "load": "Nm"},
        outputs={"speed": "rad/s"},
        parameters={"J": (TRUE["J"], "kg m2"), "b": TRUE["b"], "kt": TRUE["kt"]},
        equations={"w": "(kt*i - b*w - load) / J"},
        output_equations={"speed": "w"},
    )


def simulated() -> xr.Dataset:
    """The recording, with the load among its inputs."""
    rng = np.random.default_rng(SEED)
    current = np.repeat(rng.uniform(-4, 4, SAMPLES // 250), 250)
    load = 0.03 + np.cumsum(SIGMA_LOAD * rng.standard_normal(SAMPLES))
    both = np.column_stack([current, load])
    return bs.simulate(motor(), both, dt=DT, sigma_y=SIGMA_Y, seed=SEED)


def texts() -> dict[str, str]:
    """Both files by name: the same numbers as an English and as a German logger writes them."""
    made = simulated()
    table = np.column_stack([made["time"], made["u"][:, 0], made["y"]])
    lines = io.StringIO()
    np.savetxt(lines, table, delimiter=",", fmt=["%.3f", "%.4f", "%.4f"])
    rows = lines.getvalue()
    english = "".join(f"# {line}\n" for line in HEADER.splitlines())
    german = rows.replace(",", ";").replace(".", ",")
    return {
        "motor.csv": f"{english}time [s],current [A],speed [rad/s]\n{rows}",
        "motor_german.csv": f"Zeit [s];Strom [A];Drehzahl [rad/s]\n{german}",
    }


if __name__ == "__main__":
    for name, text in texts().items():
        place = Path(__file__).with_name(name)
        place.write_text(text, encoding="utf-8", newline="\n")
        print(f"wrote {place}")

"""Make the recording `stage.csv` beside this file: a nanopositioning stage loses its payload.

It simulates the stage of a study: `pip install backsight-studies`.
"""

import io
from pathlib import Path

import numpy as np

from backsight_studies.nanopositioner.plant import DT, simulate_stage

SAMPLES, SEED = 4000, 0
TRUTH = ("q", "v", "k", "b", "c")
HEADER = f"""\
Simulated recording of a nanopositioning stage at {1 / DT:g} Hz, by make_recording.py (seed {SEED}).
A pseudo-random binary voltage excites the stage. At 0.2 s its payload is taken off: its natural
frequency jumps from 423 Hz to 483 Hz, and an unknown force acts on it from then on.
Voltage, displacement and their truth are behind the same band-pass filter (100 Hz, 450 Hz).
u_V: voltage; y_um: measured displacement, noise 0.001 um before the filter.
The truth, only for comparison: q_um displacement, v_um_s speed, and per unit of mass
k stiffness [1/s2], b damping [1/s], c gain of the actuator [um/s2/V].
After Poloni, Eielsen, Rohal-Ilkiv, Johansen: Moving horizon observer for vibration dynamics with
plant uncertainties in nanopositioning system estimation, ACC 2012; its data are not public."""


def recording_text() -> str:
    """The whole file as text."""
    stage = simulate_stage(SEED, samples=SAMPLES)
    table = np.column_stack(
        [stage["time"], stage["u"], stage["y"], stage["x_true"].sel(state=list(TRUTH))]
    )
    lines = io.StringIO()
    np.savetxt(lines, table, delimiter=",", fmt=["%.4f", *["%.9g"] * 7])
    comments = "".join(f"# {line}\n" for line in HEADER.splitlines())
    return f"{comments}t_s,u_V,y_um,q_um,v_um_s,k,b,c\n{lines.getvalue()}"


if __name__ == "__main__":
    place = Path(__file__).with_name("stage.csv")
    place.write_text(recording_text(), encoding="utf-8", newline="\n")
    print(f"wrote {place}")

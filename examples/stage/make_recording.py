"""Make the recording `stage.csv` beside this file: a nanopositioning stage loses its payload.

It simulates the stage of a study: `pip install backsight-studies`.
"""

import io
from pathlib import Path

import numpy as np

import backsight as bs
from backsight_studies.nanopositioner.plant import DT, WITH_PAYLOAD, WITHOUT_PAYLOAD, plant

SAMPLES, PRE_ROLL, SEED = 4000, 2000, 0
BEGIN, END = 0.02, 0.38
FORCE = 2e4
TRUTH = ("q", "v", "k", "b", "c")
HEADER = f"""\
Simulated recording of a nanopositioning stage at {1 / DT:g} Hz, by make_recording.py (seed {SEED}).
A pseudo-random binary voltage excites the stage. From {BEGIN:g} s to {END:g} s its payload trickles
off: its natural frequency goes from 423 Hz to 483 Hz, and an unknown force comes up.
u_V: voltage; y_um: measured displacement, noise 0.001 um.
The truth, only for comparison: q_um displacement, v_um_s speed, and per unit of mass
k stiffness [1/s2], b damping [1/s], c gain of the actuator [um/s2/V].
After Poloni, Eielsen, Rohal-Ilkiv, Johansen: Moving horizon observer for vibration dynamics with
plant uncertainties in nanopositioning system estimation, ACC 2012; its data are not public."""


def gone(seconds: np.ndarray) -> np.ndarray:
    """Share of the payload that has trickled off."""
    since = np.clip((seconds - PRE_ROLL * DT - BEGIN) / (END - BEGIN), 0, 1)
    return 0.5 - 0.5 * np.cos(np.pi * since)


def per_mass(share: float) -> dict[str, float]:
    """Parameters per unit of the mass that is left; the damping goes along evenly."""
    mass = 1 + share * (WITH_PAYLOAD["k"] / WITHOUT_PAYLOAD["k"] - 1)
    damping = WITH_PAYLOAD["b"] + share * (WITHOUT_PAYLOAD["b"] - WITH_PAYLOAD["b"])
    return {"k": WITH_PAYLOAD["k"] / mass, "b": damping, "c": WITH_PAYLOAD["c"] / mass}


def recording_text() -> str:
    """The whole file as text."""
    n = PRE_ROLL + SAMPLES
    times = DT * np.arange(n)
    stage = bs.simulate(
        plant(),
        bs.signals.prbs(n, seed=SEED, samples_per_bit=5, amplitude=1.5),
        dt=DT,
        changes={t: per_mass(s) for t, s in zip(times[::5], gone(times[::5]), strict=True)},
        disturbances={"v": lambda t: FORCE * gone(t)},
        sigma_y=1e-3,
        seed=1000 + SEED,
    ).isel(time=slice(PRE_ROLL, None))
    table = np.column_stack(
        [times[:SAMPLES], stage["u"], stage["y"], stage["x_true"].sel(state=list(TRUTH))]
    )
    lines = io.StringIO()
    np.savetxt(lines, table, delimiter=",", fmt=["%.4f", *["%.9g"] * 7])
    comments = "".join(f"# {line}\n" for line in HEADER.splitlines())
    return f"{comments}t_s,u_V,y_um,q_um,v_um_s,k,b,c\n{lines.getvalue()}"


if __name__ == "__main__":
    place = Path(__file__).with_name("stage.csv")
    place.write_text(recording_text(), encoding="utf-8", newline="\n")
    print(f"wrote {place}")

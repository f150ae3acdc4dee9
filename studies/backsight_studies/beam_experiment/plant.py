"""The measured beam of section 5, simulated: Table 4, and a hammer."""

import numpy as np
import xarray as xr

from backsight.models.forces.unknown_forces import forces_as_inputs
from backsight.models.lti import state_space
from backsight.models.model import Model
from backsight.models.structures.modal import modal
from backsight.run.simulation import measured_recording, simulate
from backsight.types import Array
from backsight_studies.beam.plant import DAMPING, DT, FORCES, NODES, SENSORS, THICKNESS, model

SAMPLES = 45
"""Length of the recording: 35 full windows."""

FREQUENCIES = {
    "f2 = 61.58 Hz": (8.76, 61.58, 180.52),
    "f2 = 56.99 Hz": (8.76, 56.99, 180.52),
}
"""Measured frequencies of Table 4 as printed, and with f2 from the printed deviation [Hz]."""

PRINTED = ((8.76, 8.76, 0.0), (61.58, 54.88, -3.71), (180.52, 153.66, -14.88))
"""Rows of Table 4: measured, model [Hz], deviation [%]."""

NODE = 5
"""Where the hammer hits: the sensor s2."""

MIDDLE, HALF, PEAK = 18.0, 1.5, 9.0
"""The force is a parabola: its middle and half its duration [sampling periods], its peak [N].

It is 8 N in the middle of steps 17 and 18 and zero in the middle of their neighbours.
"""

SUBSTEPS = 50


def hammer(time: Array) -> Array:
    """Force of the hammer [N] at times [s]."""
    return np.maximum(PEAK * (1 - ((time / DT - MIDDLE) / HALF) ** 2), 0.0)


def reference() -> Array:
    """Force in the middle of every step (samples, nodes), as the paper's Fig. 16 [N]."""
    d = np.zeros((SAMPLES, len(NODES)))
    d[:, NODE] = hammer((np.arange(SAMPLES, dtype=np.float64) + 0.5) * DT)
    return d


def impulse() -> float:
    """Of the hammer, in N times sampling periods."""
    return 4 / 3 * PEAK * HALF


def true_model(frequencies: tuple[float, ...]) -> Model:
    """Beam of 3 mm with the measured frequencies; the hammer is its input."""
    _, B, C, _ = state_space(forces_as_inputs(model(THICKNESS[0.0]), FORCES))
    modes = len(frequencies)
    return modal(
        frequencies,
        damping=DAMPING,
        sensors={name: ("displacement", C[i, :modes]) for i, name in enumerate(SENSORS)},
        inputs={"hammer": B[modes:, NODE]},
        name="measured beam",
    )


def struck(frequencies: tuple[float, ...], *, sigma: float, seed: int) -> xr.Dataset:
    """Simulate the recording on a fine grid, and measure it at the sampling period."""
    fine = DT / SUBSTEPS
    time = (np.arange(SAMPLES * SUBSTEPS, dtype=np.float64) + 0.5) * fine
    run = simulate(true_model(frequencies), {"hammer": hammer(time)}, dt=fine, substeps=2)
    kept = run.isel(time=slice(None, None, SUBSTEPS))
    return measured_recording(
        model(THICKNESS[0.0]),
        dt=DT,
        u=np.zeros((SAMPLES, 0)),
        x=kept["x_true"].values,
        y=kept["y"].values,
        z=np.zeros((SAMPLES, 0)),
        parameters=reference(),
        sigma=np.full(len(SENSORS), sigma),
        seed=seed,
    )

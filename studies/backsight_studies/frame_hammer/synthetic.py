"""Simulated hits at every height, on a rig that differs from the model as a real one does.

The simulation takes another way than the windows: a model of the package with its sensors,
integrated by a Runge-Kutta method.
"""

import dataclasses

import numpy as np

import backsight as bs
from backsight.models.views.sensors import Sensor, with_sensors
from backsight.types import Array
from backsight_studies.frame_hammer.rig import DT, LSB, SENSORS, STRONG, SUBSTEPS, WEAK, Axis
from backsight_studies.frame_hammer.source import Hammer, Recording

FINE = 2 * SUBSTEPS
"""Steps of the simulation per sample."""

FIRST, EVERY, JITTER = 0.35, 0.5, 0.02
"""Time of the first hit, from one to the next, and by how much that varies [s]."""

REBOUNDS = 0.4
"""Share of hits after which the hammer touches the beam again."""

NOISE, OFFSET = 0.06, 0.5
"""Standard deviations of a reading, and of the zero of a sensor [m/s2]."""


@dataclasses.dataclass(frozen=True)
class Errors:
    """Relative standard deviations of the rig from the model; of places in metres."""

    frequency: float = 0.003
    damping: float = 0.3
    gain: float = 0.03
    cutoff: float = 0.04
    limit: float = 0.03
    sensor_place: float = 0.004
    hit_place: float = 0.008


def simulated(
    height: float, *, seed: int, hits: int = 3, axis: Axis = WEAK, errors: Errors | None = None
) -> Recording:
    """Hits at one height [m], with rebounds, noise, 10-bit readings and channels read in turn.

    In the strong direction the pulses are half as long.
    """
    e, rng = errors or Errors(), np.random.default_rng(seed)
    time = FIRST + EVERY * np.arange(hits) + rng.uniform(-JITTER, JITTER, hits)
    impulse = rng.uniform(0.13, 0.28, hits)
    width = rng.uniform(1.8e-3, 2.6e-3) * (0.5 if axis is STRONG else 1.0)
    samples = int((time[-1] + EVERY / 2) / DT)
    force = np.zeros(samples * FINE)
    for t, size in zip(time, impulse, strict=True):
        force += _pulse(len(force), t, width, size)
        if rng.random() < REBOUNDS:
            later, share = t + rng.uniform(0.02, 0.08), rng.uniform(0.02, 0.06)
            force += _pulse(len(force), later, 1.3 * width, share * size)
    twist = 0.1 * rng.standard_normal() * force
    model = _rig(axis, height, e, rng)
    raw = bs.simulate(model, {"F": force, "T": twist}, dt=DT / FINE, substeps=1)["y"].values
    turn = FINE // SUBSTEPS
    read = np.stack([raw[turn * j :: FINE][:samples, j] for j in range(len(SENSORS))], axis=1)
    read = read * (1 + e.gain * rng.standard_normal(len(SENSORS)))
    read += OFFSET * rng.standard_normal(len(SENSORS)) + NOISE * rng.standard_normal(read.shape)
    return Recording(
        f"simulated, {height:.2f} m, seed {seed}",
        LSB * np.round(read / LSB),
        Hammer(time, np.full(hits, height), impulse),
    )


def _pulse(steps: int, middle: float, width: float, impulse: float) -> Array:
    """Force that rises faster than it falls."""
    phase = (DT / FINE * np.arange(steps) - middle) / width + 0.5
    shape = np.where((phase > 0) & (phase < 1), np.sin(np.pi * np.clip(phase, 0, 1) ** 0.85), 0.0)
    return impulse * shape / (shape.sum() * DT / FINE)


def _rig(axis: Axis, height: float, e: Errors, rng: np.random.Generator) -> bs.Model:
    """The rig with everything a little different."""
    n = axis.modes
    places = np.array(SENSORS) + e.sensor_place * rng.standard_normal(len(SENSORS))
    hit = height + e.hit_place * rng.standard_normal()
    other = dataclasses.replace(axis, tip_inertia=axis.tip_inertia * rng.uniform(0.6, 1.5))
    seen, driven = other.at(tuple(places)), other.at((hit,))[:, 0]
    structure = bs.modal(
        np.array(axis.frequencies) * (1 + e.frequency * rng.standard_normal(n)),
        damping=np.array(axis.damping) * np.exp(e.damping * rng.standard_normal(n)),
        sensors={
            f"a{j + 1}": ("acceleration", np.append(seen[:, j], axis.seen[-1, j]))
            for j in range(len(SENSORS))
        },
        inputs={"F": np.append(driven, 0.0), "T": np.eye(n)[-1]},
    )
    cutoff = axis.cutoff * (1 + e.cutoff * rng.standard_normal(len(SENSORS)))
    limit = axis.limit * (1 + e.limit * rng.standard_normal())
    sensors = (Sensor(limit=limit, cutoff=float(f)) for f in cutoff)
    return with_sensors(
        structure, {s.name: k for s, k in zip(structure.outputs, sensors, strict=True)}
    )

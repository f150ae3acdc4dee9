"""The nanopositioning stage as simulated, and recordings of it in files.

The measured data of the paper are not public. The stage here has the natural frequencies and
damping ratios of its section VI.B before and after the payload is taken off.
"""

import math
import os
from pathlib import Path

import numpy as np
import xarray as xr

from backsight.errors import DataError
from backsight.models.model import Model
from backsight.models.signals import Signal
from backsight.run.simulation import simulate
from backsight.schema import recording
from backsight.signals import bandpass, filtered, prbs
from backsight.types import Array

DT = 1e-4
"""Sampling period [s]."""

SAMPLES = 4002
"""Samples of a recording: 1 ... 4000 are judged, and eq. 39 needs a neighbour on both sides."""

PRE_ROLL = 2000
"""Samples before the recording begins, in which the transients of plant and filter fade."""

REMOVAL = 2000
"""Sample of the recording at which the payload is taken off."""

COLUMNS = (
    "u_filt_V",
    "y_filt_um",
    "q_true_filt_um",
    "v_true_filt_um_s",
    "w_filt_um_s2",
    "k_over_m",
    "b_over_m",
    "c_over_m",
)
"""Columns of a recording in a file, one row per sample."""

TRUTH = {"q": "um", "v": "um/s", "w": "um/s2", "k": "1/s2", "b": "1/s", "c": "um/s2/V"}
"""Name and unit of the columns with the truth, in their order."""


def _per_mass(frequency: float, damping: float) -> dict[str, float]:
    omega = 2 * math.pi * frequency
    stiffness = omega**2
    # The actuator's force is the same before and after, so c/m changes like k/m.
    gain = 5.4e5 * stiffness / (2 * math.pi * 423.0) ** 2
    return {"k": stiffness, "b": 2 * damping * omega, "c": gain}


WITH_PAYLOAD = _per_mass(423.0, 0.0146)
WITHOUT_PAYLOAD = _per_mass(483.0, 0.0143)
"""Stiffness [1/s2], damping [1/s] and actuator gain [um/s2/V] per mass."""


def plant(mode2: float = 0.0) -> Model:
    """One mode, and a second one in parallel at 1100 Hz that no estimator knows of.

    Parameters
    ----------
    mode2 : float
        Gain of the second mode per gain of the first; with 0.3 its static share is 4 %.
    """
    omega = 2 * math.pi * 1100.0
    return Model(
        f=lambda x, u, p: [
            x.v,
            -p.k * x.q - p.b * x.v + p.c * u.V,
            x.v2,
            -(omega**2) * x.q2 - 2 * 0.02 * omega * x.v2 + mode2 * p.c * u.V,
        ],
        h=lambda x, _u, _p: [x.q + x.q2],
        states={"q": "um", "v": "um/s", "q2": "um", "v2": "um/s"},
        inputs={"V": "V"},
        outputs={"y": "um"},
        parameters={n: Signal(unit=TRUTH[n], value=v) for n, v in WITH_PAYLOAD.items()},
        name="nanopositioning stage, simulated",
    )


def removal_force(time: Array) -> Array:
    """Unknown force per mass [um/s2]: a half-sine pulse of 3 ms at the removal, then constant."""
    since = time - (PRE_ROLL + REMOVAL) * DT
    # Rounding of the time must not put the first sample after the removal before it.
    gone = since > -1e-9
    pulse = np.where(since < 3e-3, 2e5 * np.sin(math.pi * since / 3e-3), 0.0)
    return np.where(gone, 2e4 + pulse, 0.0)


def simulate_stage(
    seed: int, *, mode2: float = 0.0, damping: float = 0.1, samples: int = SAMPLES
) -> xr.Dataset:
    """Record the stage under a pseudo-random binary voltage while its payload is taken off.

    Parameters
    ----------
    seed : int
        Of excitation and sensor noise.
    mode2 : float
        See `plant`.
    damping : float
        Damping ratio of the band-pass filter on u and y, see `backsight.signals.bandpass`.
    samples : int
        Length of the recording.

    Returns
    -------
    xarray.Dataset
        Recording with input ``V`` [V], output ``y`` [um] and ``x_true``, all of them behind the
        band-pass filter except the parameters.
    """
    n = PRE_ROLL + samples
    raw = simulate(
        plant(mode2),
        prbs(n, seed=seed, samples_per_bit=5, amplitude=1.5),
        dt=DT,
        changes={(PRE_ROLL + REMOVAL) * DT: WITHOUT_PAYLOAD},
        disturbances={"v": removal_force},
        sigma_y=1e-3,
        seed=1000 + seed,
    )
    truth = {str(n): raw["x_true"].sel(state=n).values for n in raw["state"].values}
    signals = np.column_stack(
        [
            raw["u"].values,
            raw["y"].values,
            truth["q"] + truth["q2"],
            truth["v"] + truth["v2"],
            removal_force(raw["time"].values),
        ]
    )
    b, a = bandpass(DT, damping=damping)
    parameters = [truth[p] for p in ("k", "b", "c")]
    table = np.column_stack([filtered(signals, b=b, a=a), *parameters])
    return _as_recording(table[PRE_ROLL:])


def read_recording(path: str | os.PathLike[str]) -> xr.Dataset:
    """Read a recording with the `COLUMNS`; the first line is their names behind a ``#``.

    Raises
    ------
    DataError
        If the file cannot be read or has other columns.
    """
    try:
        names = Path(path).read_text(encoding="utf-8").partition("\n")[0].lstrip("#").split(",")
        table = np.loadtxt(path, delimiter=",", ndmin=2)
    except (OSError, ValueError) as error:
        raise DataError(f"recording '{path}' cannot be read: {error}") from None
    if tuple(n.strip() for n in names) != COLUMNS or table.shape[1] != len(COLUMNS):
        raise DataError(f"recording '{path}' must begin with '# {','.join(COLUMNS)}'")
    if not np.isfinite(table).all():
        raise DataError(f"recording '{path}' has a value that is not finite")
    return _as_recording(table)


def as_table(stage: xr.Dataset) -> Array:
    """Samples of a recording in the order of the `COLUMNS`, (n, 8)."""
    truth = stage["x_true"].sel(state=list(TRUTH)).values
    return np.hstack([stage["u"].values, stage["y"].values, truth])


def _as_recording(table: Array) -> xr.Dataset:
    stage = recording(
        np.arange(len(table)) * DT,
        u=table[:, :1],
        y=table[:, 1:2],
        inputs={"V": "V"},
        outputs={"y": "um"},
        dt=DT,
    )
    stage["x_true"] = (("time", "state"), table[:, 2:])
    return stage.assign_coords(state=list(TRUTH), state_unit=("state", list(TRUTH.values())))

"""What is in memory is one part, however many there are."""

import gc
import tracemalloc

import h5py
import numpy as np
import pytest

from backsight.data.parts import read_parts
from backsight.estimators import KalmanFilter, Noise, Prior
from backsight.models import sdof
from backsight.run.estimation import Outputs
from backsight.run.parts import estimate_parts, read_store

MODEL = sdof(k=40.0, b=0.8)
METHOD = KalmanFilter(Noise(sigma_y=1e-3, sigma_w=1e-5), Prior(sigma_x0=0.1))
PART = 20_000
KEPT = Outputs(("x_std",))


def written(folder, samples):
    """A recording of a plant at rest."""
    with h5py.File(folder / f"{samples}.h5", "w") as file:
        file["force"] = np.zeros(samples)
        file["place"] = 1e-3 * np.random.default_rng(3).standard_normal(samples)


def collected(done, count):
    """Let garbage go between parts; when it goes by itself is chance."""
    gc.collect()


def in_parts(folder, samples):
    parts = read_parts(
        folder / f"{samples}.h5",
        inputs={"u": "force"},
        outputs={"y": "place"},
        dt=0.02,
        samples=PART,
    )
    estimate_parts(
        METHOD,
        MODEL,
        parts,
        folder / str(samples),
        outputs=KEPT,
        progress=collected,
    )


def peak(work):
    """Most bytes that were in use at once."""
    tracemalloc.start()
    try:
        work()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.slow
def test_memory_is_that_of_one_part(tmp_path):
    """What is read and written altogether would not fit into what is used."""
    for samples in (PART, 2 * PART, 10 * PART):
        written(tmp_path, samples)
    in_parts(tmp_path, PART)  # imports, machine code
    few = peak(lambda: in_parts(tmp_path, 2 * PART))
    many = peak(lambda: in_parts(tmp_path, 10 * PART))
    assert many == pytest.approx(few, rel=0.1)
    assert read_store(tmp_path / str(10 * PART)).nbytes > 1.1 * many

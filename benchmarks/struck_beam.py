"""Sparse forces on a beam: the recording of the compressive-sensing paper, and its windows."""

import dataclasses
import functools
import itertools

import numpy as np

from backsight.engine import native, vm
from backsight.engine.recursion import Recursion
from backsight.estimators.base import setting
from backsight.estimators.cs_mhe import CompressiveSensingMHE
from backsight.models.beam import beam
from backsight.models.model import Model
from backsight.run.estimation import match
from backsight.types import Array
from backsight_studies.beam import plant
from backsight_studies.beam.tuning import CARRYOVERS, READING_3, TABLE, estimator
from backsight_studies.beam.windows import program
from benchmarks.contest import Contender

CASES = tuple(plant.THICKNESS)
"""Error of the frequencies that the model has [%]."""

HARDEST = -10.0
"""The case whose time is shown against nodes and window."""

REPEATS = 20
"""How often the recording is run in a round: it is short."""


@dataclasses.dataclass(frozen=True)
class Window:
    """Find the forces of a window of N + 1 samples.

    Parameters
    ----------
    x_bar, P : (nx,), (nx, nx) arrays
        A-priori estimate of the first state and its covariance.
    Y : (N + 1, ny) array
        Outputs.
    mean, spread : (N, forces) arrays
        Forces that the window before lets expect, and their standard deviations; 0 where none is.
    forces : (N, forces) array
        What Backsight finds.
    """

    x_bar: Array
    P: Array
    Y: Array
    mean: Array
    spread: Array
    forces: Array


def data() -> tuple[Array, ...]:
    """Inputs, outputs and mask of the recording: four hits, no noise."""
    return match(plant.model(plant.THICKNESS[0.0]), plant.struck(plant.forces()))


def of_paper(case: float) -> tuple[CompressiveSensingMHE, Model]:
    """The estimator with the values of Table 3, complete Algorithm 1, and its mistaken model."""
    thickness = plant.THICKNESS[case]
    carryover = CARRYOVERS[READING_3]
    return estimator(thickness, TABLE[case], carryover=carryover), plant.model(thickness)


@functools.cache
def windows(case: float) -> tuple[Window, ...]:
    """All full windows, as the algorithm meets them."""
    mhe, model = of_paper(case)
    s = setting(model, plant.DT, noise=mhe.noise, prior=mhe.prior)
    told, recording = program(mhe, model, plant.DT), plant.struck(plant.forces())
    u, y, mask = data()
    _, outputs = native.run(told.recursion, [u, y, mask], carry=told.recursion.carry0)
    nx, ny, N, nf = len(s.x0), y.shape[1], mhe.N, len(mhe.forces)
    # The memory begins with the arrival cost of the coming window. Before the innovations that
    # wait, it ends with the expected forces and their variances.
    waiting, size = mhe.delay * (ny + ny * (ny + 1) // 2), N * nf
    made = []
    found = told.run(recording).alpha
    for k, forces in enumerate(found, start=N):
        memory = outputs[-1][k - 1]
        x_bar, P, expected = memory[:nx], memory[nx : nx + nx**2], memory[: len(memory) - waiting]
        mean, variance = expected[-2 * size :].reshape(2, N, nf)
        made.append(
            Window(
                x_bar=s.sx * x_bar,
                P=np.outer(s.sx, s.sx) * P.reshape(nx, nx),
                Y=y[k - N : k + 1],
                mean=mean,
                spread=np.sqrt(variance),
                forces=forces,
            )
        )
    return tuple(made)


def native_engine(case: float) -> Contender:
    """The full windows of the recording, with everything that the algorithm does."""
    mhe, model = of_paper(case)
    recursion = mhe.compile(model, plant.DT)
    _, outputs = vm.run(recursion, data(), carry=recursion.carry0)
    forces = outputs[_output(recursion)][mhe.N :]
    measured = _full_windows(mhe, model, data(), repeats=REPEATS)
    return dataclasses.replace(measured, expected=forces)


def with_nodes(nodes: int) -> Contender:
    """The same with more places for the forces, in a longer recording."""
    names = tuple(f"F{i}" for i in range(nodes))
    places = np.linspace(plant.NODES[0], plant.LENGTH, nodes)
    model = beam(
        plant.LENGTH,
        width=plant.WIDTH,
        thickness=plant.THICKNESS[HARDEST],
        youngs_modulus=plant.YOUNGS_MODULUS,
        density=plant.DENSITY,
        damping=plant.DAMPING,
        sensors={name: ("displacement", x) for name, x in plant.SENSORS.items()},
        forces=dict(zip(names, places, strict=True)),
    )
    mhe, _ = of_paper(HARDEST)
    # The forces in the background stay as strong all together.
    sigma = mhe.sigma_force * np.sqrt(len(plant.NODES) / nodes)
    return _full_windows(
        dataclasses.replace(mhe, forces=names, sigma_force=sigma), model, longer_data()
    )


def with_horizon(N: int) -> Contender:
    """The same with another window, in a longer recording."""
    mhe, model = of_paper(HARDEST)
    return _full_windows(dataclasses.replace(mhe, N=N), model, longer_data())


@functools.cache
def longer_data() -> tuple[Array, ...]:
    """The four hits over and over again."""
    hits = (
        dataclasses.replace(hit, step=12 * i + 12)
        for i, hit in enumerate(itertools.islice(itertools.cycle(plant.HITS), 20))
    )
    recording = plant.struck(plant.forces(tuple(hits), 260))
    return match(plant.model(plant.THICKNESS[0.0]), recording)


def _full_windows(
    mhe: CompressiveSensingMHE, model: Model, recording: tuple[Array, ...], *, repeats: int = 1
) -> Contender:
    recursion = mhe.compile(model, plant.DT)
    found = _output(recursion)
    before, rest = ([d[part] for d in recording] for part in (slice(mhe.N), slice(mhe.N, None)))
    carry, _ = native.run(recursion, before, carry=recursion.carry0)

    def work() -> Array:
        for _ in range(repeats):
            _, outputs = native.run(recursion, rest, carry=carry)
        return outputs[found]

    return Contender(work, repeats * len(rest[0]))


def _output(recursion: Recursion) -> int:
    """Which output the forces are."""
    return [channel.name for channel in recursion.channels].index("d_raw")

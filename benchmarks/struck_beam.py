"""Sparse forces on a beam: the recording of the compressive-sensing paper, and its windows."""

import dataclasses
import functools
import itertools

import casadi as ca
import numpy as np

from backsight.engine import native, vm
from backsight.engine.recursion import Recursion
from backsight.estimators.cs_mhe import CompressiveSensingMHE
from backsight.estimators.scaled import setting
from backsight.models.model import Model
from backsight.run.estimation import match, run_on
from backsight.types import Array
from benchmarks import cantilever
from benchmarks.contest import Contender

CASES = tuple(cantilever.THICKNESS)
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
    return match(cantilever.model(0.0), cantilever.struck())


def of_paper(case: float) -> tuple[CompressiveSensingMHE, Model]:
    """The estimator with the values of Table 3, complete Algorithm 1, and its mistaken model."""
    return cantilever.estimator(case), cantilever.model(case)


@functools.cache
def windows(case: float) -> tuple[Window, ...]:
    """All full windows, as the algorithm meets them."""
    mhe, model = of_paper(case)
    s = setting(model, cantilever.DT, noise=mhe.noise, prior=mhe.prior)
    recursion = _with_memory(mhe.compile(model, cantilever.DT))
    u, y, mask = data()
    # The last window is full when as many samples as the horizon have come after it.
    _, outputs = native.run(recursion, run_on([u, y, mask], mhe.N), carry=recursion.carry0)
    first, memories = outputs[_output(recursion)], outputs[-1]
    nx, ny, N, nf = len(s.x0), y.shape[1], mhe.N, len(mhe.forces)
    # The memory begins with the arrival cost of the coming window. Before the innovations that
    # wait, it ends with the forces that were found, from the second step on, with the expected
    # ones and with their variances.
    waiting, size = mhe.delay * (ny + ny * (ny + 1) // 2), N * nf
    made = []
    for k in range(N, len(y)):
        before, after = (memories[i][: memories.shape[1] - waiting] for i in (k - 1, k))
        mean, variance = before[-2 * size :].reshape(2, N, nf)
        found, expected, _ = after[-3 * size :].reshape(3, N, nf)
        later = np.where(found != 0, found, expected)[:-1]
        x_bar, P = before[:nx], before[nx : nx + nx**2].reshape(nx, nx)
        made.append(
            Window(
                x_bar=s.sx * x_bar,
                P=np.outer(s.sx, s.sx) * P,
                Y=y[k - N : k + 1],
                mean=mean,
                spread=np.sqrt(variance),
                forces=np.vstack([first[k], later]),
            )
        )
    return tuple(made)


def _with_memory(recursion: Recursion) -> Recursion:
    """Put the memory of a recursion out as well, after its other outputs."""
    inputs = [ca.MX.sym(f"i{i}", recursion.step.numel_in(i)) for i in range(recursion.step.n_in())]
    carry, *outputs = recursion.step.call(inputs)
    step = ca.Function(f"{recursion.name}_memory", inputs, [carry, *outputs, carry])
    return dataclasses.replace(recursion, step=step)


def native_engine(case: float) -> Contender:
    """The full windows of the recording, with everything that the algorithm does."""
    mhe, model = of_paper(case)
    recursion = mhe.compile(model, cantilever.DT)
    _, outputs = vm.run(recursion, data(), carry=recursion.carry0)
    forces = outputs[_output(recursion)][mhe.N :]
    measured = _full_windows(mhe, model, data(), repeats=REPEATS)
    return dataclasses.replace(measured, expected=forces)


def with_nodes(nodes: int) -> Contender:
    """The same with more places for the forces, in a longer recording."""
    places = np.linspace(cantilever.FIRST, cantilever.LENGTH, nodes)
    model = cantilever.model(HARDEST, places)
    names = tuple(p.name for p in model.parameters)
    mhe, _ = of_paper(HARDEST)
    # The forces in the background stay as strong all together.
    sigma = mhe.sigma_force * np.sqrt(len(cantilever.NODES) / nodes)
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
    hits = tuple(itertools.islice(itertools.cycle(cantilever.HITS), 20))
    return match(cantilever.model(0.0), cantilever.struck(hits, 260))


def _full_windows(
    mhe: CompressiveSensingMHE, model: Model, recording: tuple[Array, ...], *, repeats: int = 1
) -> Contender:
    recursion = mhe.compile(model, cantilever.DT)
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

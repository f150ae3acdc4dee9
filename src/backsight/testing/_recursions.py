"""What an engine may rely on: a recursion is a pure function of fixed size."""

import pickle

import numpy as np

from backsight.engine.recursion import Recursion
from backsight.run.estimation import estimate, stream
from backsight.testing.case import Subject
from backsight.testing.close import assert_close, assert_same, require


def pure(on: Subject) -> None:
    """A recursion changes nothing that it is given, and does the same each time."""
    recursion = on.recursion()
    arrays = on.problem.simulate(40, seed=1, hold=on.hold, noisy=True).arrays
    carry = recursion.carry0.copy()
    untouched = [carry.copy(), *(a.copy() for a in arrays)]
    first = on.step(recursion, arrays, carry)
    again = on.step(recursion, arrays, carry)
    for before, after in zip(untouched, [carry, *arrays], strict=True):
        assert_same(after, before, "what the recursion was given")
    assert_same(again[0], first[0], "the carry of a second run")
    for a, b in zip(first[1], again[1], strict=True):
        assert_same(b, a, "the output of a second run")


def memory_sizes(on: Subject) -> None:
    """Carry and outputs have the sizes that the recursion and its channels say."""
    recursion, problem = on.recursion(), on.problem
    data = problem.simulate(7, seed=1, hold=on.hold, noisy=True)
    carry, outputs = on.step(recursion, data.arrays)
    require(
        carry.shape == recursion.carry0.shape,
        f"the carry goes from {recursion.carry0.shape} to {carry.shape}",
    )
    expected = (1, problem.ny, problem.ny)
    require(
        recursion.input_sizes == expected,
        f"the data are of {recursion.input_sizes} numbers; u, y and mask have {expected}",
    )
    lengths = {"state": problem.nx, "output": problem.ny, "parameter": 1, "force": 1, "limit": 1}
    for output, size, channel in zip(
        outputs, recursion.output_sizes, recursion.channels, strict=True
    ):
        require(output.shape == (7, size), f"'{channel.name}' has the shape {output.shape}")
        shape = (7, *(lengths[d.rstrip("_")] for d in channel.dims))
        found = channel.unpack(output).shape
        require(found == shape, f"'{channel.name}' becomes {found}; its dims say {shape}")


def engine_does_what_one_step_after_the_other_does(on: Subject) -> None:
    """The engine agrees with CasADi's own evaluation of the step: see `scan` if it does not."""
    recursion = on.recursion()
    data = on.problem.simulate(60, seed=2, hold=on.hold, noisy=True)
    data.y[3:5] = np.nan
    data.y[::4, -1] = np.nan
    carry, outputs = on.step(recursion, data.arrays)
    expected_carry, expected = _step_by_step(recursion, data.arrays)
    assert_close(carry, expected_carry, 1e-10, "the carry")
    for channel, output, reference in zip(recursion.channels, outputs, expected, strict=True):
        assert_close(output, reference, 1e-10, channel.name)


def block_size_is_irrelevant(on: Subject) -> None:
    """An engine may take the samples in blocks."""
    recursion = on.recursion()
    arrays = on.problem.simulate(50, seed=3, hold=on.hold, noisy=True).arrays
    _, whole = on.step(recursion, arrays)
    _, blocks = on.step(recursion, arrays, block=7)
    for channel, a, b in zip(recursion.channels, whole, blocks, strict=True):
        assert_same(b, a, channel.name)


def carry_is_all_the_memory(on: Subject) -> None:
    """A recording may be cut in two where one likes, if the carry is handed on."""
    recursion = on.recursion()
    arrays = on.problem.simulate(50, seed=3, hold=on.hold, noisy=True).arrays
    end, whole = on.step(recursion, arrays)
    carry, head = on.step(recursion, [a[:23] for a in arrays])
    later, tail = on.step(recursion, [a[23:] for a in arrays], carry)
    assert_same(later, end, "the carry")
    for channel, a, b, c in zip(recursion.channels, whole, head, tail, strict=True):
        assert_same(np.vstack([b, c]), a, channel.name)


def progress_ends_with_the_number_of_samples(on: Subject) -> None:
    """Progress is told block by block."""
    arrays = on.problem.simulate(25, seed=3, hold=on.hold, noisy=True).arrays
    told: list[int] = []
    on.step(on.recursion(), arrays, block=10, progress=told.append)
    require(told == [10, 20, 25], f"progress is {told}, not [10, 20, 25]")


def stream_is_the_batch(on: Subject) -> None:
    """Sample by sample the results are those of the whole recording."""
    data = on.problem.simulate(40, seed=4, hold=on.hold, noisy=True)
    data.y[2] = np.nan
    data.y[::3, 0] = np.nan
    estimator, model = on.build(on.problem), on.problem.model
    batch = estimate(estimator, model, data.recording(model), engine=on.engine)
    live = stream(estimator, model, batch.attrs["dt"], engine=on.engine)
    for k in range(len(data.u)):
        sample = live.step(data.u[k], data.y[k])
        for name in ("x_hat", "P", "y_hat", "S", "status"):
            assert_same(sample[name], batch[name].values[k], f"{name} of sample {k}")


def pickles(on: Subject) -> None:
    """Estimator and recursion survive a trip to another process."""
    recursion, problem = on.recursion(), on.problem
    arrays = problem.simulate(30, seed=5, hold=on.hold, noisy=True).arrays
    expected = on.run(recursion, arrays)
    estimator = pickle.loads(pickle.dumps(on.build(problem)))
    thawed = pickle.loads(pickle.dumps(recursion))
    for revived in (thawed, estimator.compile(problem.model, recursion.dt)):
        require(revived.channels == recursion.channels, "the channels have changed")
        for name, values in on.run(revived, arrays).items():
            assert_same(values, expected[name], name)


def long_runs_keep_the_covariance_positive(on: Subject) -> None:
    """P is symmetric and positive definite after 20 000 samples, too."""
    data = on.problem.simulate(on.amount(20_000), seed=6, hold=on.hold, noisy=True)
    P = on.run(on.recursion(), data.arrays)["P"]
    assert_same(P, P.transpose(0, 2, 1), "P'")
    size = np.sqrt(np.einsum("kii->ki", P))
    correlation = P / (size[:, :, None] * size[:, None, :])
    smallest = np.linalg.eigvalsh(correlation)[:, 0].min()
    require(smallest > 0, f"the smallest eigenvalue of the correlations is {smallest:.2e}")


def _step_by_step(
    recursion: Recursion, arrays: list[np.ndarray]
) -> tuple[np.ndarray, list[np.ndarray]]:
    """The reference for every engine: call the step function on one sample after the other."""
    carry, rows = recursion.carry0, []
    for sample in zip(*arrays, strict=True):
        results = [np.asarray(r)[:, 0] for r in recursion.step.call([carry, *sample])]
        carry = results[0]
        rows.append(results[1:])
    return carry, [np.array(column) for column in zip(*rows, strict=True)]

"""What an engine may rely on: a recursion is a pure function of fixed size."""

import pickle

import numpy as np
import pytest

from backsight.engine.recursion import Recursion
from backsight.estimators import ESTIMATORS
from backsight.run.estimation import estimate, stream
from closeness import assert_close
from contract.cases import CASES


def test_every_estimator_has_a_case():
    assert set(CASES) == set(ESTIMATORS)
    assert all(key == estimator.key for key, estimator in ESTIMATORS.items())


def test_pure(engine, recursion, problem, hold):
    arrays = problem.simulate(40, seed=1, hold=hold, noisy=True).arrays
    carry = recursion.carry0.copy()
    untouched = [carry.copy(), *(a.copy() for a in arrays)]
    first = engine(recursion, arrays, carry=carry)
    again = engine(recursion, arrays, carry=carry)
    for before, after in zip(untouched, [carry, *arrays], strict=True):
        np.testing.assert_array_equal(before, after)
    np.testing.assert_array_equal(first[0], again[0])
    for a, b in zip(first[1], again[1], strict=True):
        np.testing.assert_array_equal(a, b)


def test_sizes(engine, recursion, problem, hold):
    data = problem.simulate(7, seed=1, hold=hold, noisy=True)
    carry, outputs = engine(recursion, data.arrays, carry=recursion.carry0)
    assert carry.shape == recursion.carry0.shape
    assert recursion.input_sizes == (1, problem.ny, problem.ny)
    for output, size, channel in zip(
        outputs, recursion.output_sizes, recursion.channels, strict=True
    ):
        sizes = {"state": problem.nx, "output": problem.ny, "parameter": 1, "force": 1, "limit": 1}
        assert output.shape == (7, size)
        dims = [d.rstrip("_") for d in channel.dims]
        assert channel.unpack(output).shape == (7, *(sizes[d] for d in dims))


def test_engine_does_what_one_step_after_the_other_does(engine, recursion, problem, hold):
    data = problem.simulate(60, seed=2, hold=hold, noisy=True)
    data.y[3:5] = np.nan
    data.y[::4, -1] = np.nan
    carry, outputs = engine(recursion, data.arrays, carry=recursion.carry0)
    expected_carry, expected = step_by_step(recursion, data.arrays)
    assert_close(carry, expected_carry, 1e-10)
    for output, reference in zip(outputs, expected, strict=True):
        assert_close(output, reference, 1e-10)


def test_block_size_is_irrelevant(engine, recursion, problem, hold):
    arrays = problem.simulate(50, seed=3, hold=hold, noisy=True).arrays
    _, whole = engine(recursion, arrays, carry=recursion.carry0)
    _, blocks = engine(recursion, arrays, carry=recursion.carry0, block=7)
    for a, b in zip(whole, blocks, strict=True):
        np.testing.assert_array_equal(a, b)


def test_carry_is_all_the_memory(engine, recursion, problem, hold):
    arrays = problem.simulate(50, seed=3, hold=hold, noisy=True).arrays
    end, whole = engine(recursion, arrays, carry=recursion.carry0)
    carry, head = engine(recursion, [a[:23] for a in arrays], carry=recursion.carry0)
    later, tail = engine(recursion, [a[23:] for a in arrays], carry=carry)
    np.testing.assert_array_equal(end, later)
    for a, b, c in zip(whole, head, tail, strict=True):
        np.testing.assert_array_equal(a, np.vstack([b, c]))


def test_progress_ends_with_the_number_of_samples(engine, recursion, problem, hold):
    arrays = problem.simulate(25, seed=3, hold=hold, noisy=True).arrays
    told = []
    engine(recursion, arrays, carry=recursion.carry0, block=10, progress=told.append)
    assert told == [10, 20, 25]


@pytest.mark.parametrize("name_of_engine", ["vm", "native"])
def test_stream_is_the_batch(build, problem, hold, name_of_engine):
    data = problem.simulate(40, seed=4, hold=hold, noisy=True)
    data.y[2] = np.nan
    data.y[::3, 0] = np.nan
    estimator, model = build(problem), problem.model
    batch = estimate(estimator, model, data.recording(model), engine=name_of_engine)
    live = stream(estimator, model, batch.attrs["dt"], engine=name_of_engine)
    for k in range(len(data.u)):
        sample = live.step(data.u[k], data.y[k])
        for name in ("x_hat", "P", "y_hat", "S", "status"):
            np.testing.assert_array_equal(sample[name], batch[name].values[k], err_msg=name)


def test_pickles(run, build, recursion, problem, hold):
    arrays = problem.simulate(30, seed=5, hold=hold, noisy=True).arrays
    expected = run(recursion, arrays)
    estimator = pickle.loads(pickle.dumps(build(problem)))
    thawed = pickle.loads(pickle.dumps(recursion))
    for revived in (thawed, estimator.compile(problem.model, recursion.dt)):
        assert revived.channels == recursion.channels
        for name, values in run(revived, arrays).items():
            np.testing.assert_array_equal(values, expected[name])


@pytest.mark.parametrize("hold", ["zoh"])
def test_long_runs_keep_the_covariance_positive(run, recursion, problem, hold):
    data = problem.simulate(20_000, seed=6, hold=hold, noisy=True)
    P = run(recursion, data.arrays)["P"]
    np.testing.assert_array_equal(P, P.transpose(0, 2, 1))
    size = np.sqrt(np.einsum("kii->ki", P))
    correlation = P / (size[:, :, None] * size[:, None, :])
    assert np.linalg.eigvalsh(correlation)[:, 0].min() > 0


def step_by_step(
    recursion: Recursion, arrays: list[np.ndarray]
) -> tuple[np.ndarray, list[np.ndarray]]:
    """The reference for every engine: call the step function on one sample after the other."""
    carry, rows = recursion.carry0, []
    for sample in zip(*arrays, strict=True):
        results = [np.asarray(r)[:, 0] for r in recursion.step.call([carry, *sample])]
        carry = results[0]
        rows.append(results[1:])
    return carry, [np.array(column) for column in zip(*rows, strict=True)]

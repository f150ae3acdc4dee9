import math

import numpy as np
import pytest
import xarray as xr

from backsight.analysis.consistency.whiteness import (
    autocorrelation,
    colours,
    cross_correlation,
    normalised,
)


def as_result(r: np.ndarray, u: np.ndarray, variance: float = 4.0) -> xr.Dataset:
    """Innovations r (n, ny), given per standard deviation, with inputs u (n, nu)."""
    e = math.sqrt(variance) * r
    S = variance * np.broadcast_to(np.eye(r.shape[1]), (len(r), r.shape[1], r.shape[1]))
    return xr.Dataset(
        {
            "e": (("time", "output"), e),
            "y": (("time", "output"), e),
            "S": (("time", "output", "output_"), S),
            "u": (("time", "input"), u),
        },
        coords={
            "output": [f"y{i}" for i in range(r.shape[1])],
            "input": [f"u{i}" for i in range(u.shape[1])],
        },
    )


def white(n=4000, *, seed=0, ny=1, nu=1):
    rng = np.random.default_rng(seed)
    return rng.standard_normal((n, ny)), rng.standard_normal((n, nu))


def test_autocorrelation_is_the_plain_loop_over_pairs_that_were_measured():
    r, u = white(400)
    r = np.clip(r, -2.5, 2.5)
    r[np.random.default_rng(3).random(400) < 0.3] = np.nan
    found = autocorrelation(as_result(r, u), 5)
    for lag in range(1, 6):
        pairs = [(a, b) for a, b in zip(r[lag:, 0], r[:-lag, 0], strict=True)]
        pairs = [(a, b) for a, b in pairs if math.isfinite(a) and math.isfinite(b)]
        total = sum(a * b for a, b in pairs)
        size = math.sqrt(sum(a * a for a, _ in pairs) * sum(b * b for _, b in pairs))
        spread = math.sqrt(sum((a * b) ** 2 for a, b in pairs))
        assert float(found.correlation.sel(lag=lag)[0]) == pytest.approx(total / size)
        assert float(found.bound.sel(lag=lag)[0]) == pytest.approx(1.959964 * spread / size)


def test_bound_covers_as_often_as_it_says():
    hits = []
    for seed in range(40):
        r, u = white(600, seed=seed)
        r *= np.linspace(0.5, 2.0, 600)[:, None]
        found = autocorrelation(as_result(r, u), 10)
        hits.append(np.abs(found.correlation) < found.bound)
    assert np.mean(hits) == pytest.approx(0.95, abs=0.025)


def test_white_innovations_are_doubted_as_often_as_the_level_says():
    found = [colours(as_result(*white(600, seed=s)))[0] for s in range(200)]
    assert np.mean([c.p_white < 0.1 for c in found]) == pytest.approx(0.1, abs=0.05)
    assert np.mean([c.p_input < 0.1 for c in found]) == pytest.approx(0.1, abs=0.05)


def test_whiteness_does_not_depend_on_the_size_that_was_predicted():
    r, u = white()
    small, large = (colours(as_result(c * r, u))[0] for c in (0.1, 10.0))
    assert small.lag1 == pytest.approx(large.lag1)
    assert small.p_white == pytest.approx(large.p_white)
    assert small.explained == pytest.approx(large.explained)


def test_colour_is_found_with_its_output_and_lag():
    r, u = white(ny=2)
    r[3:, 1] += 0.6 * r[:-3, 1]
    first, second = colours(as_result(r, u))
    assert first.p_white > 0.01
    assert second.p_white < 1e-6
    assert (second.output, second.lag) == ("y1", 3)
    assert second.largest == pytest.approx(0.6 / 1.36, abs=0.05)


def test_input_that_explains_innovations_is_named_with_its_delay():
    r, u = white(nu=2)
    r[4:, 0] += 0.5 * u[:-4, 1]
    (colour,) = colours(as_result(r, u))
    assert (colour.input, colour.delay) == ("u1", 4)
    assert colour.explained == pytest.approx(0.2, abs=0.03)
    assert colour.p_input < 1e-6


def test_feedback_of_coloured_innovations_is_no_fault_of_the_model():
    """A controller carries innovations over to its command; only noise made them predictable."""
    r, _ = white(8000, seed=2)
    for k in range(1, len(r)):
        r[k] += 0.8 * r[k - 1]
    u = -0.5 * np.vstack([np.zeros((1, 1)), r[:-1]])
    (colour,) = colours(as_result(r, u + 0.1 * white(8000, seed=5)[0]))
    assert abs(colour.lag1) > 0.5
    assert colour.explained < 0.01


def test_cross_correlation_knows_past_and_future():
    r, u = white()
    r[2:, 0] += u[:-2, 0]
    r[:-1, 0] += u[1:, 0]
    found = cross_correlation(as_result(r, u), 4)
    outside = np.abs(found.correlation) > 2 * found.bound
    assert found.lag.values[outside[:, 0, 0]].tolist() == [-1, 2]


def test_few_wild_innovations_do_not_decide():
    r, u = white()
    r[100:102] = 1e4
    (colour,) = colours(as_result(r, u))
    assert abs(colour.lag1) < 0.05


def test_nothing_is_said_of_nothing():
    r, u = white(30)
    (colour,) = colours(as_result(r * np.nan, u))
    assert math.isnan(colour.p_white)
    assert math.isnan(colour.p_input)
    (colour,) = colours(as_result(white(500)[0], np.empty((500, 0))))
    assert (colour.input, colour.delay) == ("", 0)
    assert math.isnan(colour.p_input)


def test_channels_without_a_variance_are_left_out():
    r, u = white(50)
    result = as_result(r, u)
    S = result.S.values.copy()
    S[7] = 0.0
    found = normalised(result.assign(S=(result.S.dims, S)))
    assert np.flatnonzero(np.isnan(found[:, 0])).tolist() == [7]

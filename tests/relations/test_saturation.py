"""Readings at the end of the range of a sensor count as not measured, everywhere."""

import dataclasses

import numpy as np
import pytest

import backsight as bs
from backsight.discrete.runge_kutta import Integrator
from backsight.errors import ModelError
from backsight.models.views.scale import scale
from backsight.run.diagnosis import clipped_readings, saturated_readings
from backsight.testing import CASES
from closeness import assert_close


def limited(model, ends):
    """The model whose first sensor has a range."""
    first = dataclasses.replace(model.outputs[0], saturation=ends)
    return dataclasses.replace(model, outputs=(first, *model.outputs[1:]))


def clipped(case, n=40):
    """Model with the range, the recording clipped, and the one with gaps instead."""
    problem = case.problem
    recording = problem.simulate(n, seed=3, hold="zoh", noisy=True).recording(problem.model)
    y = recording["y"].values
    low, high = np.quantile(y[:, 0], [0.1, 0.8])
    cut, gaps = y.copy(), y.copy()
    cut[:, 0] = np.clip(y[:, 0], low, high)
    gaps[(y[:, 0] <= low) | (y[:, 0] >= high), 0] = np.nan
    of = limited(problem.model, (low, high))
    return (
        of,
        recording.assign(y=(("time", "output"), cut)),
        recording.assign(y=(("time", "output"), gaps)),
    )


@pytest.mark.parametrize("key", CASES)
def test_every_estimator_leaves_them_out(key):
    case = CASES[key]
    model, cut, gaps = clipped(case)
    estimator = case.build(case.problem, Integrator("rk4", 1, "zoh"))
    plain = bs.estimate(estimator, case.problem.model, gaps, engine="vm")
    result = bs.estimate(estimator, model, cut, engine="vm")
    for name in ("x_hat", "P", "e", "S", "y"):
        np.testing.assert_array_equal(np.isnan(result[name]), np.isnan(plain[name]))
        assert_close(np.nan_to_num(result[name].values), np.nan_to_num(plain[name].values), 1e-12)


def test_smoothers_outlier_rules_and_streams_leave_them_out():
    problem = CASES["ekf"].problem
    model, cut, gaps = clipped(CASES["ekf"])
    noise = dataclasses.replace(problem.noise, outliers=bs.settings.Gate())
    for estimator in (
        bs.EKF(noise, problem.prior, integrator=Integrator("rk4", 1)),
        bs.MHE(noise, problem.prior, N=4, integrator=Integrator("rk4", 1)),
    ):
        plain = bs.estimate(estimator, problem.model, gaps, engine="vm")
        result = bs.estimate(estimator, model, cut, engine="vm")
        assert_close(result["x_hat"].values, plain["x_hat"].values, 1e-12)
        stream = bs.stream(estimator, model, dt=float(cut.attrs["dt"]), engine="vm")
        for u, y in zip(cut["u"].values, cut["y"].values, strict=True):
            now = stream.step(u, y)
        assert_close(np.array(now["x_hat"]), plain["x_hat"].values[-1], 1e-12)
    ekf = bs.EKF(problem.noise, problem.prior, integrator=Integrator("rk4", 1))
    back = [bs.smooth(ekf, m, d, engine="vm") for m, d in ((model, cut), (problem.model, gaps))]
    assert_close(back[0]["x_hat"].values, back[1]["x_hat"].values, 1e-12)


def test_one_end_is_enough_and_rounding_of_units_does_not_hide_it():
    model, cut, _ = clipped(CASES["kf"])
    _, high = model.outputs[0].saturation
    y = cut["y"].values[:, 0]
    assert (y == high).sum() > 5
    one = limited(model, (-np.inf, high / 3 * 3 * (1 + 1e-13)))
    (line,) = saturated_readings(one, cut)
    assert f"{(y == high).sum()} of {len(y)} readings" in line


def test_a_range_goes_along_with_the_scale():
    model = limited(bs.sdof(k=40.0, b=0.8), (-0.2, 0.4))
    model = dataclasses.replace(model, outputs=(dataclasses.replace(model.outputs[0], scale=0.1),))
    assert scale(model).outputs[0].saturation == pytest.approx((-2.0, 4.0))


def test_clipped_readings_are_seen_and_the_line_to_write_is_said():
    plant = bs.sdof(k=40.0, b=0.8, c=1.0)
    force = np.sin(0.05 * np.arange(2000))[:, None]
    recording = bs.simulate(plant, force, dt=0.02, sigma_y=1e-4, seed=1)
    assert clipped_readings(plant, recording) == []
    top = float(np.quantile(recording["y"], 0.9))
    cut = recording.assign(y=recording["y"].clip(max=top))
    (line,) = clipped_readings(plant, cut)
    assert f"saturation = [-inf, {top:.7g}]" in line
    assert clipped_readings(limited(plant, (-1.0, top)), cut) == []


def test_ends_the_wrong_way_round_are_refused():
    with pytest.raises(ModelError, match="give the lower end first"):
        bs.Signal("m", saturation=(2.0, -2.0))

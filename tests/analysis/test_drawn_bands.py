"""Ends of bands as report and figures draw them."""

import base64

import numpy as np
import pytest

import backsight as bs
from backsight.analysis.bands import innovation_band, state_band
from backsight.report._series import Series
from backsight.report.figures.bands import state_plots


@pytest.fixture(scope="module")
def results():
    """A bounded parameter at its bound, a positive one, and an outlier that was left out."""
    model = bs.Model(
        f=lambda x, u, p: [x.v, -p.k * x.q - p.c * x.v + u.F],
        h=lambda x, u, p: [x.q],
        states={"q": "m", "v": "m/s"},
        inputs={"F": "N"},
        outputs={"y": "m"},
        parameters={"k": bs.Signal(value=30.0, positive=True), "c": bs.Signal(value=0.1, lower=0)},
    )
    recording = bs.simulate(
        model, np.ones((60, 1)), dt=0.05, parameters={"k": 40.0, "c": 0.0}, sigma_y=1e-3, seed=1
    )
    recording["y"][30, 0] += 1.0
    noise = bs.Noise(sigma_y=1e-3, sigma_w={"v": 1e-3}, outliers=bs.settings.Gate())
    prior = bs.Prior(sigma_x0={"q": 0.01, "v": 0.1, "k": 10.0, "c": 0.5})
    return bs.estimate(bs.EKF(noise, prior), bs.augment(model, ["k", "c"]), recording, engine="vm")


def test_a_band_of_a_positive_state_is_a_factor(results):
    low, high = state_band(results, "k", deviations=1.0)
    np.testing.assert_allclose(low, results["x_low"].sel(state="k"), rtol=1e-12)
    np.testing.assert_allclose(high, results["x_high"].sel(state="k"), rtol=1e-12)
    x = results["x_hat"].sel(state="k").values
    low, high = state_band(results, "k")
    assert (low > 0).all()
    np.testing.assert_allclose(low * high, x**2, rtol=1e-12)


def test_a_band_ends_at_a_bound(results):
    low, high = state_band(results, "c")
    x, std = (results[v].sel(state="c").values for v in ("x_hat", "x_std"))
    assert (low >= 0).all()
    assert (low == 0).any()
    np.testing.assert_allclose(high, x + 3 * std)
    free = state_band(results, "q")
    np.testing.assert_allclose(free[1] - free[0], 6 * results["x_std"].sel(state="q"))


def test_the_report_and_the_figures_draw_these_bands(results):
    (plot,) = state_plots([Series("EKF", results, 0)], {}, ["c"])
    y = plot.traces[0]["y"]
    shaded = np.frombuffer(base64.b64decode(y["bdata"]), y["dtype"])
    assert np.nanmin(shaded) == pytest.approx(0, abs=1e-12)
    figure = bs.plot.draw_states(results, ["c", "k"])
    for axes, name in zip(figure.axes, ("c", "k"), strict=True):
        drawn = axes.collections[0].get_paths()[0].vertices[:, 1]
        low, high = state_band(results, name)
        assert drawn.min() == pytest.approx(low.min())
        assert drawn.max() == pytest.approx(high.max())


def test_innovations_that_a_rule_left_out_are_not_drawn(results):
    e, bound = innovation_band(results, "y")
    assert np.isnan(e[30])
    assert 0 < bound[30] < 0.1
    figure = bs.plot.draw_innovations(results)
    drawn = figure.axes[0].lines[0].get_ydata()
    assert np.nanmax(np.abs(drawn)) < 0.1

"""Whole figures: every line and band is that of the result, with name and unit."""

import numpy as np
import pytest

import backsight as bs
from backsight import plot
from backsight.errors import DataError

PLANT = bs.sdof(k=40.0, b=0.8, c=1.0)
NOISE, PRIOR = bs.Noise(sigma_y=1e-3, sigma_w={"v": 1e-3}), bs.Prior(sigma_x0=0.1)


@pytest.fixture(scope="module")
def results():
    force = np.sign(np.sin(0.1 * np.arange(200)))[:, None]
    recording = bs.simulate(PLANT, force, dt=0.02, sigma_y=1e-3, seed=1)
    recording["y"][50:60] = np.nan
    filters = {"KF": bs.KalmanFilter(NOISE, PRIOR), "MHE": bs.MHE(NOISE, PRIOR, N=5)}
    return {n: bs.estimate(f, PLANT, recording, engine="vm") for n, f in filters.items()}


def titles(figure):
    return [axes.get_title(loc="left") for axes in figure.axes]


def test_states_with_bands_truth_and_reference(results):
    made = plot.draw_states(results, ["v"], reference={"v": 0.3})
    assert titles(made) == ["v [m/s]"]
    first, second, true, reference = made.axes[0].get_lines()
    np.testing.assert_array_equal(first.get_ydata(), results["KF"].x_hat.sel(state="v"))
    np.testing.assert_array_equal(second.get_ydata(), results["MHE"].x_hat.sel(state="v"))
    np.testing.assert_array_equal(true.get_ydata(), results["KF"].x_true.sel(state="v"))
    assert set(reference.get_ydata()) == {0.3}
    edge = made.axes[0].collections[0].get_paths()[0].vertices[:, 1].max()
    state = results["KF"].sel(state="v")
    assert edge == pytest.approx(float((state.x_hat + 3 * state.x_std).max()))
    assert made.axes[-1].get_xlabel() == "time [s]"


def test_one_result_is_called_as_its_estimator(results):
    made = plot.draw_outputs(results["KF"])
    assert [t.get_text() for t in made.axes[0].get_legend().get_texts()] == ["measured", "kf"]
    assert np.isnan(made.axes[0].get_lines()[0].get_ydata()).sum() == 10


def test_innovations_lie_between_three_deviations(results):
    made = plot.draw_innovations(results)
    assert titles(made) == ["KF: innovation of y [m]", "MHE: innovation of y [m]"]
    e, low, high = (line.get_ydata() for line in made.axes[0].get_lines())
    np.testing.assert_allclose(high, 3 * np.sqrt(results["KF"]["S"].values[:, 0, 0]))
    np.testing.assert_array_equal(low, -high)
    assert np.nanmean(np.abs(e) < high) > 0.9


def test_spectrum_of_white_innovations_is_one():
    rng = np.random.default_rng(0)
    resting = bs.lti(
        [[-1.0]], np.zeros((1, 0)), [[0.0]], states={"x": "m"}, inputs={}, outputs={"y": "m"}
    )
    recording = bs.from_arrays(y=rng.normal(size=(4000, 1)), dt=0.01, inputs={}, outputs={"y": "m"})
    white = bs.estimate(
        bs.KalmanFilter(bs.Noise(sigma_y=1.0), bs.Prior(sigma_x0=1.0)), resting, recording
    )
    f, density = plot.draw_spectrum(white).axes[0].get_lines()[0].get_data()
    assert f[-1] < 50.0
    assert np.mean(density) == pytest.approx(1.0, abs=0.05)


def test_nis_comparison_window(results):
    assert titles(plot.draw_nis(results)) == ["mean NIS of 10 samples [1]"]
    made = plot.draw_comparison(results)
    assert [t.get_text() for t in made.axes[0].get_yticklabels()] == ["KF", "MHE"]
    assert titles(made) == ["mean NIS and its 95 % band [1]", "time per sample [us]"]
    recording = results["KF"][["u", "y", "x_true"]].assign_attrs(dt=0.02)
    window = bs.solve_window(bs.MHE(NOISE, PRIOR, N=5), PLANT, recording, at=100)
    line = plot.draw_window(window, ["q"]).axes[0].get_lines()[0]
    np.testing.assert_array_equal(line.get_ydata(), window.x.sel(state="q"))


def test_virtual_outputs_with_bands_and_truth():
    model = bs.with_virtual(PLANT, {"spring": ("k*q", "N")})
    recording = bs.simulate(model, np.ones(30), dt=0.02, sigma_y=1e-3, seed=1)
    result = bs.estimate(bs.KalmanFilter(NOISE, PRIOR), model, recording, engine="vm")
    made = plot.draw_virtual(result)
    assert titles(made) == ["spring [N]"]
    line, true = made.axes[0].get_lines()
    np.testing.assert_array_equal(line.get_ydata(), result.z_hat.sel(virtual="spring"))
    np.testing.assert_array_equal(true.get_ydata(), result.z_true.sel(virtual="spring"))


def test_figure_shows_itself_in_a_notebook(results):
    assert plot.draw_states(results)._repr_png_().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("draw", "message"),
    [
        (lambda r: plot.draw_states(r, ["w"]), "no state 'w'"),
        (lambda r: plot.draw_outputs(r, ["yy"]), "did you mean 'y'"),
        (lambda _: plot.draw_states({}), "at least one"),
        (lambda r: plot.draw_virtual(r), "no virtual outputs"),
        (lambda r: plot.draw_forces(r), "no result has unknown forces"),
        (lambda r: plot.draw_window(r["KF"]), "draw_states"),
    ],
)
def test_what_is_not_there_is_said(results, draw, message):
    with pytest.raises(DataError, match=message):
        draw(results)


def test_a_map_of_recovery_has_the_ratios_of_every_place():
    sensors, places = {"tip": ("displacement", [1.0])}, {"hit": [1.0]}
    rod = bs.modal([9.0], damping=[0.03], sensors=sensors, forces=places)
    noise = bs.Noise(sigma_y=1e-3)
    finder = bs.CompressiveSensingMHE(noise, PRIOR, forces=("hit",), lam=15.0, N=4)
    certified = bs.check.check_recovery(finder, rod, dt=0.01)
    made = plot.draw_recovery(certified)
    drawn = made.axes[0].get_images()[0].get_array()
    np.testing.assert_array_equal(drawn, certified["ratio"].values.T)
    assert [t.get_text() for t in made.axes[0].get_xticklabels()] == ["4", "3", "2", "1"]
    with pytest.raises(DataError, match="check_recovery"):
        plot.draw_recovery(certified.drop_vars("ratio"))

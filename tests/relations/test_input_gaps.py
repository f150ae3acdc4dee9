"""Inputs that were not recorded at every sample: states that a walk drives in the gaps."""

import numpy as np
import pytest

import backsight as bs
from backsight.errors import DataError, ModelError, ProblemError
from backsight.problem import load
from backsight.problem.recorded import recording_of
from closeness import assert_close

DT, N = 2e-3, 2500
STAGE = bs.Model(
    f=lambda x, u, p: [x.v, (-p.k * x.q - p.c * x.v + u.F) / 0.8],
    h=lambda x, u, p: [x.q],
    states={"q": "m", "v": "m/s"},
    inputs={"F": "N", "G": "N"},
    outputs={"y": "m"},
    parameters={"k": bs.Signal(value=700.0, lower=0.0), "c": bs.Signal(value=2.5, lower=0.0)},
)
WALK = {"v": 1e-6, "F": 0.05}
SPREAD = {"q": 1e-3, "v": 0.01, "k": 300.0, "c": 1.5, "F": 1.0}
RK4 = bs.Integrator("rk4")


@pytest.fixture(scope="module")
def pushed():
    """A recording whose force walks, and the force with gaps in it."""
    rng = np.random.default_rng(0)
    force = np.cumsum(0.05 * rng.standard_normal(N))
    force -= np.convolve(force, np.ones(400) / 400, "same")
    recording = bs.simulate(
        STAGE, np.column_stack([force, 0 * force]), dt=DT, sigma_y=1e-5, seed=3,
        parameters={"k": 900.0, "c": 1.5},
    )  # fmt: skip
    told = force + 1e-4 * rng.standard_normal(N)
    for start in (500, 1100, 1900):
        told[start : start + 60] = np.nan
    return recording, told


def with_outputs(recording, told):
    y = np.column_stack([recording["y"].values[:, 0], told])
    return bs.from_arrays(
        u=recording["u"].values[:, 1], y=y, dt=DT, inputs={"G": "N"}, outputs={"y": "m", "F": "N"}
    )


def estimated(recording, *, inputs=()):
    model = bs.augment(STAGE, ["k", "c"], inputs=inputs)
    walk = {n: s for n, s in WALK.items() if n in {s.name for s in model.states}}
    prior = {s.name: SPREAD[s.name] for s in model.states}
    sigma = {"y": 1e-5} | ({"F": 1e-4} if inputs else {})
    ekf = bs.EKF(bs.Noise(sigma_y=sigma, sigma_w=walk), bs.Prior(sigma_x0=prior), integrator=RK4)
    return bs.estimate(ekf, model, recording)


def deviations(result):
    last = result.isel(time=-1).sel(state=["k", "c"])
    return np.abs(last["x_hat"].values - [900.0, 1.5]) / last["x_std"].values


def test_parameters_are_right_in_spite_of_gaps_and_wrong_if_these_are_filled(pushed):
    recording, told = pushed
    result = estimated(with_outputs(recording, told), inputs=["F"])
    assert (deviations(result) < 3).all()
    k = np.arange(N)
    there = np.isfinite(told)
    line = np.interp(k, k[there], told[there])
    filled = recording.assign(u=recording["u"].copy(data=np.column_stack([line, 0 * line])))
    assert (deviations(estimated(filled)) > 20).all()
    force = result["x_hat"].sel(state="F").values - recording["u"].values[:, 0]
    band = 3 * result["x_std"].sel(state="F").values
    assert np.mean(np.abs(force[~there]) < band[~there]) > 0.95
    assert np.isnan(result["e"].sel(output="F").values[~there]).all()


def test_a_complete_reading_is_a_known_input(pushed):
    recording, _ = pushed
    force = recording["u"].values[:300, 0]
    part = recording.isel(time=slice(300))
    one = estimated(with_outputs(part, force), inputs=["F"])
    other = estimated(part)
    for name, close in (("q", 1e-3), ("k", 1e-3), ("c", 5e-2)):
        a, b = (r["x_hat"].sel(state=name).values[-1] for r in (one, other))
        assert a == pytest.approx(b, rel=close)


def test_the_model_keeps_its_equations():
    model = bs.augment(
        bs.with_virtual(STAGE, {"a": "v_dot"}), ["c"], disturbances={"w": "v"}, inputs=["F"]
    )
    assert [s.name for s in model.states] == ["q", "v", "c", "w", "F"]
    assert [s.name for s in model.inputs] == ["G"]
    assert [(s.name, s.unit) for s in model.outputs] == [("y", "m"), ("F", "N")]
    x = [0.1, 0.2, 3.0, 0.5, 7.0]
    rate = (-700 * 0.1 - 3 * 0.2 + 7) / 0.8 + 0.5
    given = x, [9.0], model.theta
    for values, expected in (
        (model.f(*given), [0.2, rate, 0, 0, 0]),
        (model.h(*given), [0.1, 7.0]),
        (model.virtual.g(*given, np.zeros(5)), [rate]),
    ):
        np.testing.assert_allclose(np.asarray(values).ravel(), expected)
    with pytest.raises(ModelError, match="the model has no input 'H'"):
        bs.augment(STAGE, inputs=["H"])


def test_a_gap_that_nobody_allowed_is_refused_with_the_proposal(pushed):
    recording, told = pushed
    given = {"dt": DT, "outputs": {"y": "m"}}
    with pytest.raises(DataError, match=r"'F' is nan at sample 500 .* by 'gaps' in a problem"):
        bs.from_arrays(u=told, y=recording["y"].values, inputs={"F": "N"}, **given)
    holed = recording.copy(deep=True)
    holed["u"][7, 0] = np.nan
    with pytest.raises(DataError, match=r"augment\(model, inputs=\['F'\]\)"):
        estimated(holed)
    kf = bs.EKF(bs.Noise(sigma_y=1e-5), bs.Prior(sigma_x0=[1.0, 1.0]), integrator=RK4)
    live = bs.stream(kf, STAGE, DT, engine="vm")
    with pytest.raises(DataError, match="input F is not finite or missing"):
        live.step({"G": 0.0}, [0.0])


PROBLEM = """
[recording]
path = "stage.csv"
dt = 0.002
inputs.F = { column = "F", unit = "N", gaps = { walk = 0.05, sigma = 1.0, sigma_u = 1e-4 } }
inputs.G = "G"
outputs.y = { column = "y", unit = "m" }
[model]
kind = "equations"
states = { q = "m", v = "m/s" }
outputs = { y = "q" }
[model.equations]
q = "v"
v = "(-k*q - c*v + F + G) / 0.8"
[estimate]
k = { start = 700.0, sigma = 300.0 }
c = { start = 2.5, sigma = 1.5 }
[prior]
sigma_x0 = { q = 1e-3, v = 0.01 }
[noise]
sigma_y = { y = 1e-5 }
sigma_w = { v = 1e-6 }
[estimators.EKF]
kind = "ekf"
"""


def test_a_problem_file_has_a_key_for_it(pushed, tmp_path):
    recording, told = pushed
    columns = np.column_stack([told, recording["u"].values[:, 1], recording["y"].values])[480:700]
    rows = [",".join("" if np.isnan(v) else repr(v) for v in row) for row in columns.tolist()]
    (tmp_path / "stage.csv").write_text("F,G,y\n" + "\n".join(rows) + "\n")
    path = tmp_path / "stage.toml"
    path.write_text(PROBLEM)
    problem = load(path)
    data = recording_of(problem)
    assert data["input"].values.tolist() == ["G"]
    assert data["output"].values.tolist() == ["y", "F"]
    assert [s.name for s in problem.model.states] == ["q", "v", "k", "c", "F"]
    noise, prior = problem.estimators["EKF"].assumed
    np.testing.assert_allclose(np.diag(noise.measurement(problem.model)), [1e-10, 1e-8])
    np.testing.assert_allclose(np.diag(noise.process(problem.model)), [0, 1e-12, 0, 0, 0.0025])
    assert prior.covariance(problem.model)[-1, -1] == 1.0
    result = bs.estimate(problem.estimators["EKF"], problem.model, data, engine="vm")
    model = bs.augment(
        bs.from_equations(
            states={"q": "m", "v": "m/s"}, inputs={"F": "N", "G": ""}, outputs={"y": "m"},
            equations={"q": "v", "v": "(-k*q - c*v + F + G) / 0.8"}, output_equations={"y": "q"},
            parameters={"k": 700.0, "c": 2.5},
        ),
        ["k", "c"],
        inputs=["F"],
    )  # fmt: skip
    same = bs.estimate(bs.EKF(noise, prior), model, data, engine="vm")
    assert_close(result["x_hat"].values, same["x_hat"].values, 1e-12)
    path.write_text(PROBLEM.replace(", sigma_u = 1e-4", ""))
    with pytest.raises(ProblemError, match=r"recording\.inputs\.F\.gaps\.sigma_u: is missing"):
        load(path)
    twice = PROBLEM.replace('"m" }\n[model]', '"m" }\noutputs.F = "F"\n[model]')
    path.write_text(twice.replace('{ y = "q" }', '{ y = "q", F = "F" }'))
    with pytest.raises(ProblemError, match="'F' is an output, too"):
        load(path)

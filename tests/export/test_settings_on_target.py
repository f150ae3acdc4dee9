"""What may be changed on the controller: the same as an estimator made with the other values."""

import dataclasses
import re
import shutil
import subprocess

import numpy as np
import pytest

from backsight.discrete.runge_kutta import Integrator
from backsight.errors import EngineError
from backsight.estimators import EKF, MHE, MHO, UKF
from backsight.estimators.kalman import KalmanFilter
from backsight.estimators.uncertainty import Noise
from backsight.export import export_c
from backsight.testing import CASES, TrialProblem

COMPILER = shutil.which("cc")
needs_compiler = pytest.mark.skipif(COMPILER is None, reason="needs a C compiler called cc")


def recorded(problem):
    """A noisy recording with gaps."""
    data = problem.simulate(40, seed=5, hold="zoh", noisy=True)
    data.y[20:30] = np.nan
    return data.recording(problem.model)


def run_changed(folder, other, settings):
    """Run the code of a folder with changed settings through the self-test of another one."""
    text = (other / "estimator_selftest.c").read_text()
    own = (folder / "estimator_selftest.c").read_text()
    begin = text.index("    estimator_defaults(&settings);")
    first = text.index("    for (k = 0;", begin)
    here = own.index("    estimator_defaults(&settings);")
    started = own[here : own.index("    for (k = 0;", here)]
    defaults, init = started.splitlines()
    changes = [f"    settings.{k} = {v!r};" for k, v in settings.items()]
    test = folder / "changed.c"
    test.write_text("\n".join([text[:begin], defaults, *changes, init, text[first:]]))
    program = folder / "changed"
    command = [str(COMPILER), "-std=c99", "-O0", "-Wall", "-Werror", "-o", str(program)]
    files = [str(folder / "estimator.c"), str(test), "-lm"]
    built = subprocess.run([*command, *files], capture_output=True, text=True)
    assert built.returncode == 0, built.stderr
    return subprocess.run([str(program)], capture_output=True, text=True)


@needs_compiler
@pytest.mark.parametrize("method", [EKF, MHO, MHE])
def test_noise_and_parameters_of_the_target(method, tmp_path):
    problem = TrialProblem()
    fixed = {"integrator": Integrator("rk4", 2), **({} if method is EKF else {"N": 4})}
    sigma = {"position": 0.01, "speed": 0.1}
    other = {"position": 0.03, "speed": 0.05}
    walk = {"q": 1e-3, "v": 2e-2}
    recording = recorded(problem)
    stiff = dataclasses.replace(
        problem.model,
        parameters=tuple(
            dataclasses.replace(s, value=3.0) if s.name == "b" else s
            for s in problem.model.parameters
        ),
    )
    # Scales of the outputs inside come from the noise: fixed, so that both round alike.
    exported = method(Noise(sigma_y=sigma, sigma_w=walk), problem.prior, **fixed)
    wanted = method(Noise(sigma_y=other, sigma_w=walk), problem.prior, **fixed)
    export_c(exported, problem.model, recording, tmp_path / "a", tunable=["sigma_y", "b"])
    export_c(wanted, stiff, recording, tmp_path / "b")
    settings = {"sigma_y[0]": 0.03, "sigma_y[1]": 0.05, "parameters[0]": 3.0}
    ran = run_changed(tmp_path / "a", tmp_path / "b", settings)
    assert ran.returncode == 0, ran.stdout
    # And the values of the export are something else.
    assert run_changed(tmp_path / "a", tmp_path / "b", {}).returncode == 1


@needs_compiler
@pytest.mark.parametrize("key", ["ekf", "ukf"])
def test_random_walks_of_the_target(key, tmp_path):
    problem = TrialProblem()
    method = {"ekf": EKF, "ukf": UKF}[key]
    recording, fixed = recorded(problem), {"integrator": Integrator("rk4", 2)}
    sigma = {"position": 0.01, "speed": 0.1}
    # With scales given, both estimators round alike.
    model = TrialProblem(scales={"q": 0.05, "v": 0.5, "k": 40.0}).model

    def export(name, walk, **given):
        estimator = method(Noise(sigma_y=sigma, sigma_w=walk), problem.prior, **fixed)
        export_c(estimator, model, recording, tmp_path / name, **given)

    export("a", {"q": 1e-3, "v": 2e-2}, tunable=["sigma_w", "b"])
    export("b", {"q": 2e-3, "v": 1e-2})
    # The self-test of the other has no settings but those of its sensors.
    settings = {"sigma_w[0]": 2e-3, "sigma_w[1]": 1e-2}
    ran = run_changed(tmp_path / "a", tmp_path / "b", settings)
    assert ran.returncode == 0, ran.stdout
    assert run_changed(tmp_path / "a", tmp_path / "b", {}).returncode == 1


SCALES = {"q": 0.05, "v": 0.5, "k": 40.0}
"""With scales given, estimators of other settings round alike."""


def changed(estimator, model, settings):
    """Estimator and model with what settings of the target say."""
    for name, value in settings.items():
        if name in ("x0", "sigma_x0"):
            prior = dataclasses.replace(estimator.prior, **{name: value})
            estimator = dataclasses.replace(estimator, prior=prior)
        elif name in ("sigma_y", "sigma_w"):
            noise = dataclasses.replace(estimator.noise, **{name: value})
            estimator = dataclasses.replace(estimator, noise=noise)
        elif name in ("lower", "upper"):
            states = tuple(
                dataclasses.replace(s, **{name: value[s.name]}) if s.name in value else s
                for s in model.states
            )
            model = dataclasses.replace(model, states=states)
        else:
            estimator = dataclasses.replace(estimator, **{name: value})
    return estimator, model


WHAT = {
    "ekf": {
        "x0": {"q": 0.01, "v": -0.02, "k": 119.0},
        "sigma_x0": {"q": 0.02, "v": 0.3, "k": 9.0},
        "lower": {"k": 118.0},
        "upper": {"k": 122.0},
    },
    "mho": {"alpha": 0.4, "sigma_x0": {"q": 0.02, "v": 0.3, "k": 9.0}, "lower": {"k": 119.0}},
    "mhe": {
        "sigma_w": {"q": 2e-3, "v": 1e-2},
        "x0": {"q": 0.01, "v": -0.02, "k": 119.0},
        "upper": {"k": 121.0},
    },
    "csmhe": {"lam": 40.0, "threshold": 0.01, "sigma_x0": {"q": 0.02, "v": 0.3}},
    "lmhe": {"sigma_x0": {"q": 0.02, "v": 0.3}, "x0": {"q": 0.01, "v": -0.02}},
    "ukf": {"x0": {"q": 0.01, "v": -0.02, "k": 119.0}, "sigma_x0": {"q": 0.02, "v": 0.3, "k": 9.0}},
    "iekf": {"sigma_w": {"q": 2e-3, "v": 1e-2}, "lower": {"k": 118.0}},
    "joint_input": {"x0": {"q": 0.01, "v": -0.02}, "sigma_w": {"q": 2e-3, "v": 1e-2}},
    "hgo": {"x0": {"q": 0.01, "v": -0.02}},
}
QUICK = ("ekf", "csmhe")


@needs_compiler
@pytest.mark.parametrize(
    "key", [k if k in QUICK else pytest.param(k, marks=pytest.mark.slow) for k in WHAT]
)
def test_numbers_of_estimator_prior_and_bounds(key, tmp_path):
    """As a new export, and otherwise something else."""
    problem, names = CASES[key].problem, list(WHAT[key])
    scales = {name: SCALES[name] for name in (s.name for s in problem.model.states)}
    model = dataclasses.replace(
        problem.model,
        states=tuple(dataclasses.replace(s, scale=scales[s.name]) for s in problem.model.states),
        outputs=tuple(dataclasses.replace(s, scale=0.01) for s in problem.model.outputs),
    )
    estimator = CASES[key].build(problem, Integrator("rk4", 1))
    recording = recorded(problem)
    export_c(estimator, model, recording, tmp_path / "a", tunable=names)
    export_c(*changed(estimator, model, WHAT[key]), recording, tmp_path / "b", tunable=names)
    header = (tmp_path / "b" / "estimator.c").read_text()
    wanted = dict(re.findall(r"settings->(\w+\[\d+\]) = \(?([-+.\de]+)\)?;", header))
    settings = {k: float(v) for k, v in wanted.items()}
    ran = run_changed(tmp_path / "a", tmp_path / "b", settings)
    assert ran.returncode == 0, ran.stdout
    assert run_changed(tmp_path / "a", tmp_path / "b", {}).returncode == 1


def test_what_cannot_be_changed_is_refused(tmp_path):
    problem = TrialProblem()
    recording = recorded(problem)
    ekf = EKF(problem.noise, problem.prior, Integrator("rk4", 2))
    with pytest.raises(EngineError, match="'stiffness' cannot be made changeable"):
        export_c(ekf, problem.model, recording, tmp_path / "a", tunable=["stiffness"])
    known = CASES["kf"].problem
    steady = KalmanFilter(known.noise, known.prior, steady_state=True)
    linear = recorded(known)
    with pytest.raises(EngineError, match="has no noise of its sensors that could be changed"):
        export_c(steady, known.model, linear, tmp_path / "a", tunable=["sigma_y"])
    with pytest.raises(EngineError, match="sigma_w cannot be made changeable: a constant"):
        export_c(steady, known.model, linear, tmp_path / "a", tunable=["sigma_w"])
    exact = EKF(known.noise, known.prior)
    with pytest.raises(EngineError, match="matrix exponential"):
        export_c(exact, known.model, linear, tmp_path / "a", tunable=["b"])
    assert not (tmp_path / "a").exists()


@pytest.mark.slow
def test_sensors_without_noise_have_none_to_change(tmp_path):
    problem = CASES["kf"].problem
    estimator = KalmanFilter(Noise(sigma_y=0.0, sigma_w=1e-3), CASES["kf"].problem.prior)
    export_c(estimator, problem.model, recorded(problem), tmp_path / "exact")
    assert "sigma_y" not in (tmp_path / "exact" / "estimator.h").read_text()
    with pytest.raises(EngineError, match="has no noise of its sensors that could be changed"):
        export_c(estimator, problem.model, recorded(problem), tmp_path / "x", tunable=["sigma_y"])

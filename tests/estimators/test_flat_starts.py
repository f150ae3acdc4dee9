"""Parameters behind a kink: the model does not depend on them where the prior is."""

import casadi as ca
import numpy as np
import pytest

import backsight as bs
from backsight.algebra.kinks import kinked

GAP = {"g": 0.25}
VALVE = {"F_max": 3.0}


def gap():
    """A mass that touches a stop behind a gap; by the prior it never gets there."""
    model = bs.Model(
        f=lambda x, u, p: [
            x.v,
            -20 * x.q - 0.5 * x.v - 200 * ca.fmax(x.q - p.g, 0) + u.F,
        ],
        h=lambda x, u, p: [x.q],
        states={"q": "m", "v": "m/s"},
        inputs={"F": "N"},
        outputs={"y": "m"},
        parameters={"g": bs.Signal(value=0.5, unit="m")},
    )
    t = 0.02 * np.arange(300)
    force = 4 * np.sin(4.2 * t) * np.minimum(1, t / 2)
    noise = bs.Noise(sigma_y=2e-3, sigma_w={"v": 1e-2})
    return model, GAP, force, noise, bs.Prior(sigma_x0={"q": 0.01, "v": 0.05, "g": 0.15}), 0.02


def valve():
    """An actuator with an end; by the prior no command reaches it."""
    model = bs.Model(
        f=lambda x, u, p: [
            x.v,
            -20 * x.q - x.v + ca.fmin(ca.fmax(u.c, -p.F_max), p.F_max),
        ],
        h=lambda x, u, p: [x.q],
        states={"q": "m", "v": "m/s"},
        inputs={"c": "N"},
        outputs={"y": "m"},
        parameters={"F_max": bs.Signal(value=6.0, lower=0.1, unit="N")},
    )
    t = 0.05 * np.arange(200)
    command = 5 * np.sin(1.1 * t) * np.minimum(1, t / 3)
    noise = bs.Noise(sigma_y=5e-3, sigma_w={"v": 1e-2})
    return (
        model,
        VALVE,
        command,
        noise,
        bs.Prior(sigma_x0={"q": 0.01, "v": 0.05, "F_max": 2.0}),
        0.05,
    )


@pytest.mark.parametrize("case", [gap, valve])
def test_a_window_finds_the_other_side_of_a_kink(case):
    model, true, force, noise, prior, dt = case()
    recording = bs.simulate(
        model, force[:, None], dt=dt, parameters=true, sigma_y=noise.sigma_y or 1.0, seed=2
    )
    joint = bs.augment(model, list(true))
    integrator = bs.Integrator("rk4", 2)
    mhe = bs.MHE(noise, prior, N=10, integrator=integrator)
    found = bs.estimate(mhe, joint, recording, engine="vm", throw=False)
    by_points = bs.estimate(
        bs.UKF(noise, prior, integrator=integrator), joint, recording, engine="vm"
    )
    (name, value), last = next(iter(true.items())), found.isel(time=-1)
    x, std = (float(last[k].sel(state=name)) for k in ("x_hat", "x_std"))
    assert abs(x - value) < 3 * std
    assert std < 0.05 * float(found["x_std"].sel(state=name)[0])
    # What sigma points find, which see across the kink.
    ukf = by_points.isel(time=-1).sel(state=name)
    assert x == pytest.approx(float(ukf["x_hat"]), abs=std)
    assert std == pytest.approx(float(ukf["x_std"]), rel=0.25)


def test_where_a_window_is_explained_the_prior_stays():
    """Nothing is touched: the gap is anywhere beyond the motion, and the band says so."""
    model, _, force, noise, prior, dt = gap()
    recording = bs.simulate(model, 0.1 * force[:120, None], dt=dt, sigma_y=2e-3, seed=2)
    mhe = bs.MHE(noise, prior, N=10, integrator=bs.Integrator("rk4", 2))
    last = bs.estimate(mhe, bs.augment(model, ["g"]), recording).isel(time=-1).sel(state="g")
    assert float(last["x_hat"]) == pytest.approx(0.5, abs=1e-9)
    assert float(last["x_std"]) == pytest.approx(0.15, rel=1e-9)


def test_filters_without_a_slope_are_told():
    model, true, command, noise, prior, dt = valve()
    recording = bs.simulate(
        model, command[:, None], dt=dt, parameters=true, sigma_y=noise.sigma_y or 1.0, seed=2
    )
    integrator = bs.Integrator("rk4", 2)
    rivals = {kind.key: kind(noise, prior, integrator=integrator) for kind in (bs.EKF, bs.UKF)}
    joint = bs.augment(model, ["F_max"])
    found = bs.compare(rivals, joint, recording, engine="vm", throw=False)
    told = {line.split(":")[0]: line for line in found.verdicts()}
    assert "F_max was not learned" in told["ekf"]
    assert "no slope to follow; begin there" in told["ekf"]
    assert "not learned" not in told["ukf"]


def tank():
    """Water runs over at a level that the prior has too high: a jump of both flows."""

    def f(x, u, p):
        flow = u.q - 0.5 * ca.sqrt(ca.fmax(x.h, 1e-6))
        full = x.h >= p.top
        over = ca.if_else(full, ca.fmax(flow, 0), 0)
        return [flow - over, over - 0.6 * x.caught]

    model = bs.Model(
        f=f,
        h=lambda x, u, p: [x.h, x.caught],
        states={"h": bs.Signal(lower=0.0, value=0.5), "caught": ""},
        inputs={"q": ""},
        outputs={"y": "", "z": ""},
        parameters={"top": 1.4},
    )
    flow = np.where(np.arange(120) < 40, 0.3, 0.9)
    noise = bs.Noise(sigma_y=0.01, sigma_w={"h": 1e-3, "caught": 1e-3})
    prior = bs.Prior(sigma_x0={"h": 0.02, "caught": 0.02, "top": 0.3}, x0={"h": 0.5})
    return model, {"top": 1.1}, flow, noise, prior, 0.05


@pytest.mark.parametrize("kind", ["ekf", "mhe"])
def test_a_jump_has_no_slope_on_either_side_and_is_told(kind):
    model, true, flow, noise, prior, dt = tank()
    recording = bs.simulate(
        model, flow[:, None], dt=dt, x0=[0.5, 0.0], parameters=true, sigma_y=0.01, seed=2
    )
    step = bs.Integrator("rk4", 1)
    method = {
        "ekf": bs.EKF(noise, prior, step),
        "mhe": bs.MHE(noise, prior, N=4, integrator=step),
    }[kind]
    joint = bs.augment(model, ["top"])
    found = bs.compare({kind: method}, joint, recording, engine="vm", throw=False)
    told = found.verdicts()[-1]
    assert "top was not learned" in told
    assert "by a jump, which has no slope on either side" in told
    assert "MHE, which look" not in told


def test_an_arrival_cost_with_one_slope_is_told():
    model, true, command, noise, prior, dt = valve()
    recording = bs.simulate(
        model, command[:, None], dt=dt, parameters=true, sigma_y=noise.sigma_y or 1.0, seed=2
    )
    settings = {"N": 10, "integrator": bs.Integrator("rk4", 2)}
    joint, said = bs.augment(model, ["F_max"]), {}
    for arrival in (bs.settings.EKFArrival(), bs.settings.SmoothedArrival()):
        mhe = bs.MHE(noise, prior, arrival=arrival, **settings)
        found = bs.compare({"mhe": mhe}, joint, recording, engine="vm", throw=False)
        said[type(arrival).__name__] = found.verdicts()[-1]
    assert "has the slope of one side" in said["EKFArrival"]
    assert "slope" not in said["SmoothedArrival"]


def test_kinks_are_found_by_operations():
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    smooth = [ca.sin(x[0]) * x[1] + ca.fabs(u), ca.exp(-(x[0] ** 2)) / (1 + x[1] ** 2)]
    kinks = [ca.fabs(x[0]), ca.fmax(x[1] - u, 0), ca.if_else(x[0] > 1, x[1], 0), ca.sign(x[1])]
    assert not any(kinked(ca.Function("f", [x, u], [k])) for k in smooth)
    assert all(kinked(ca.Function("f", [x, u], [k])) for k in kinks)

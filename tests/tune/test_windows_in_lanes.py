"""The process noise of windows is an input of one program, as if built anew for each value."""

import numpy as np
import pytest

import backsight as bs
from backsight.engine import vm
from backsight.run.estimation import match
from backsight.tune.fitting.runners import Rebuilt, lanes_of
from backsight.tune.fitting.values import Free, unknowns_of

DT, SAMPLES = 0.01, 24
PRIOR = bs.Prior(sigma_x0=0.1)
WHOLE = np.array([[1e-8, 4e-7], [4e-7, 1e-4]])
HARDENING = bs.Model(
    f=lambda x, u, p: [x.v, -100 * x.q - 300 * x.q**3 - 0.5 * x.v + u.F + p.hit],
    h=lambda x, _u, _p: [x.q],
    states={"q": "m", "v": "m/s"},
    inputs={"F": "N"},
    outputs={"y": "m"},
    parameters={"hit": 0.0},
)
STRAIGHT = bs.second_order(
    [[1.0]], [[0.5]], [[100.0]],
    inputs={"F": "N"}, forces={"F": "q1", "hit": "q1"}, parameters={"hit": 0.0},
    outputs={"y": ("displacement", "q1")},
)  # fmt: skip


def noise(model, **more):
    first, second = (s.name for s in model.states)
    return bs.Noise(sigma_y=1e-3, **(more or {"sigma_w": {first: 1e-4, second: 1e-2}}))


def window(model, **more):
    return bs.MHE(noise(model), PRIOR, **{"N": 3, **more})


def sparse(model, **more):
    settings = {"forces": ("hit",), "lam": 30.0, "N": 4, "sigma_force": 0.1}
    return bs.CompressiveSensingMHE(noise(model), PRIOR, **(settings | more))


CASES = {
    "arrival along the window": (HARDENING, window(HARDENING), "sigma_w"),
    "a filter behind": (HARDENING, window(HARDENING, arrival=bs.settings.EKFArrival()), "sigma_w"),
    "a density": (
        HARDENING,
        bs.MHE(
            noise(HARDENING, Qc=np.diag([1e-6, 1e-2])),
            PRIOR,
            N=2,
            arrival=bs.settings.EKFArrival(),
            optimiser=bs.settings.GaussNewton(tolerance=0.0),
        ),
        "Qc.v",
    ),
    "all of Q": (HARDENING, bs.MHE(noise(HARDENING, Q=WHOLE), PRIOR, N=3), "Q"),
    "limits": (
        HARDENING,
        window(HARDENING, limits=(bs.settings.Limit("slow", {"v": 1.0}, upper=0.4),)),
        "sigma_w",
    ),
    "sparse forces": (STRAIGHT, sparse(STRAIGHT), "sigma_w"),
    "sparse forces, all of Q": (
        STRAIGHT,
        bs.CompressiveSensingMHE(
            noise(STRAIGHT, Q=WHOLE), PRIOR, forces=("hit",), lam=30.0, N=4, sigma_force=0.1
        ),
        "Q",
    ),
    "sparse forces, newest sample": (STRAIGHT, sparse(STRAIGHT, lag=0, bias="kept"), "sigma_w"),
    "sparse forces of a bent model": (HARDENING, sparse(HARDENING), "sigma_w"),
}


def data_for(model, estimator):
    rng = np.random.default_rng(0)
    y = 0.05 * rng.standard_normal((SAMPLES, 1))
    y[7:9] = np.nan
    recording = bs.from_arrays(
        dt=DT, u=rng.standard_normal((SAMPLES, 1)), y=y, inputs={"F": "N"}, outputs={"y": "m"}
    )
    u, y, mask = match(model, recording, estimator=estimator)
    seen = mask.copy()
    seen[15:18] = 0
    return u, y, seen, y, mask


def compared(model, estimator, name, run):
    """Innovations and variances of some settings, by one program and by one each."""
    other = Free("Q", structure="full") if name == "Q" else Free(name)
    unknowns = unknowns_of([Free("sigma_y"), other], estimator, model)
    data, start = data_for(model, estimator), {n.name: n.start for n in unknowns}
    moved = {n.name: n.scale.value(0.7) for n in unknowns}
    settings = [start, moved, start | {"sigma_y.y": 4e-3}]
    lanes = lanes_of(estimator, model, DT, unknowns)
    fast = run(lanes, data, settings)
    (slow,) = Rebuilt(estimator, model, unknowns, DT).innovations(data, settings)
    # Values make a difference, or equal ones would say nothing.
    assert np.abs(slow[0][1] - slow[0][0]).max() > 1e-6
    np.testing.assert_allclose(fast[0], slow[0], rtol=0, atol=1e-10)
    np.testing.assert_allclose(fast[1], slow[1], rtol=1e-9)


def one_by_one(lanes, data, settings):
    found = []
    for values in settings:
        rows, lag = lanes._rows(data, values), lanes.recursion.lag
        _, outputs = vm.run(lanes.recursion, rows, carry=lanes._start(values))
        found.append([o[lag:] for o in outputs])
    return [np.stack(k) for k in zip(*found, strict=True)]


def all_at_once(lanes, data, settings):
    (found,) = lanes.innovations(data, settings)
    return found


@pytest.mark.parametrize(
    "case",
    [
        pytest.param(case, marks=() if case in ("a density", "sparse forces") else pytest.mark.slow)
        for case in CASES
    ],
)
def test_one_program_is_as_many_built_anew(case):
    compared(*CASES[case], one_by_one)


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_in_the_lanes_of_vectors_too(case):
    compared(*CASES[case], all_at_once)


@pytest.mark.slow
def test_many_states_too():
    n = 10
    chain = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    model = bs.second_order(
        np.eye(n), 0.5 * np.eye(n), 100 * chain,
        inputs={"F": "N"}, forces={"F": "q1"}, outputs={"y": ("displacement", "q3")},
    )  # fmt: skip
    walks = {f"q{i}_dot": 1e-2 for i in range(1, n + 1)}
    mhe = bs.MHE(bs.Noise(sigma_y=1e-3, sigma_w=walks), PRIOR, N=3)
    compared(model, mhe, "sigma_w.q2_dot", one_by_one)


def test_what_does_not_go_together_is_built_anew():
    limited = window(
        HARDENING, limits=(bs.settings.Limit("push", {"v": 1.0}, upper=1.0, of="noise"),)
    )
    unknowns = unknowns_of([Free("sigma_w.v")], limited, HARDENING)
    assert lanes_of(limited, HARDENING, DT, unknowns) is None
    parameter = bs.Model(
        f=lambda x, u, p: [x.v, -p.k * x.q - 0.5 * x.v + u.F + p.hit],
        h=lambda x, _u, _p: [x.q], states={"q": "m", "v": "m/s"}, inputs={"F": "N"},
        outputs={"y": "m"}, parameters={"hit": 0.0, "k": 100.0},
    )  # fmt: skip
    estimator = sparse(parameter)
    unknowns = unknowns_of([Free("k")], estimator, parameter)
    assert lanes_of(estimator, parameter, DT, unknowns) is None

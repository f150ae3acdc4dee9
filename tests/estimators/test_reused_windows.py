"""Windows with gains that are reused: those that are solved anew, within the promised bound."""

import dataclasses

import numpy as np
import pytest

from backsight.engine import native
from backsight.estimators import MHE, EKFArrival, Limit, NoArrival, Noise, Prior
from backsight.models.structures.modal import modal

MODES, SENSORS, N, DT, SAMPLES = 7, 4, 5, 0.05, 480
NOISE, PRIOR = Noise(sigma_y=0.05, sigma_w=0.05), Prior(sigma_x0=0.5)


def machine(**bounds: float):
    rng = np.random.default_rng(4)
    given = modal(
        np.linspace(0.5, 4.0, MODES),
        damping=0.05,
        sensors={f"y{i}": ("velocity", rng.standard_normal(MODES)) for i in range(SENSORS)},
        inputs={"u": np.ones(MODES)},
    )
    if not bounds:
        return given
    first = dataclasses.replace(given.states[0], **bounds)
    return dataclasses.replace(given, states=(first, *given.states[1:]))


def recorded(*, gaps: bool) -> list[np.ndarray]:
    rng = np.random.default_rng(0)
    y = 0.5 * np.sin(0.3 * np.arange(SAMPLES)[:, None] + np.arange(SENSORS))
    mask = np.ones_like(y)
    if gaps:
        mask[180:183] = 0
        mask[240, 1] = 0
        mask[250, 2] = 0.5
    return [rng.standard_normal((SAMPLES, 1)), y + 0.05 * rng.standard_normal(y.shape), mask]


def both(model, data, **settings):
    found = []
    for gain in ("converged", "exact"):
        recursion = MHE(NOISE, PRIOR, N=N, gain=gain, **settings).compile(model, DT)
        _, outputs = native.run(recursion, data, carry=recursion.carry0)
        found.append(dict(zip([c.name for c in recursion.channels], outputs, strict=True)))
    return found


@pytest.mark.slow
@pytest.mark.parametrize(
    ("bounds", "settings"),
    [
        ({}, {}),
        ({}, {"arrival": EKFArrival()}),
        ({"upper": 0.05, "lower": -0.3}, {}),
        ({}, {"limits": (Limit("sum", {"q1": 1.0, "q2": 1.0}, upper=0.02),)}),
    ],
    ids=["plain", "filter", "bounds", "limit"],
)
def test_reused_windows(bounds, settings):
    quick, exact = both(machine(**bounds), recorded(gaps=True), **settings)
    places = np.cumsum([0, *range(2 * MODES, 1, -1)])
    sigma = np.sqrt(exact["P"][:, places])
    apart = np.abs(quick["x_hat"] - exact["x_hat"]) / sigma
    assert apart.max() < 1e-9
    for name in ("e", "y_hat", "S", "P"):
        np.testing.assert_allclose(quick[name], exact[name], rtol=1e-5, atol=1e-9)
    np.testing.assert_array_equal(quick["status"], exact["status"])
    reused = (quick["iterations"] < exact["iterations"])[:, 0]
    assert reused[100:180].any()
    assert reused[-20:].any()
    assert not reused[180 : 183 + N].any()
    assert not reused[240 : 250 + N].any()
    assert quick["kkt"][reused].max() < 1e-6


@pytest.mark.slow
def test_windows_without_a_filter_are_solved():
    recursion = MHE(NOISE, PRIOR, N=2, arrival=NoArrival()).compile(machine(), DT)
    exact = MHE(NOISE, PRIOR, N=2, arrival=NoArrival(), gain="exact").compile(machine(), DT)
    assert len(recursion.carry0) == len(exact.carry0)

"""What moves a machine need not be recorded: a road, the wind."""

import numpy as np
import pytest

import backsight as bs

WALK = 0.3


def swing(noise_only):
    inputs = {} if noise_only else {"F": "N"}
    force = (lambda _: 0.0) if noise_only else (lambda u: u.F)
    return bs.Model(
        f=lambda x, u, p: [x.v, -p.k * x.q - 0.5 * x.v + force(u)],
        h=lambda x, u, p: [x.q],
        states={"q": "m", "v": "m/s"}, inputs=inputs, outputs={"y": "m"},
        parameters={"k": (30.0, "1/s2")},
    )  # fmt: skip


MODEL = bs.augment(swing(noise_only=True), parameters=["k"])


def test_parameters_are_seen_while_noise_moves_the_machine():
    at_rest = bs.check.check_observability_along(MODEL, np.zeros((200, 0)), dt=0.02)
    moved = bs.check.check_observability_along(
        MODEL, np.zeros((200, 0)), dt=0.02, walks={"v": WALK}
    )
    assert (at_rest.rank, moved.rank) == (2, 3)
    assert "k" in " ".join(at_rest.lines())


def test_expected_bands_are_those_that_the_filter_finds():
    push = WALK / 0.02 * np.random.default_rng(0).standard_normal(3000)
    recording = bs.simulate(
        swing(noise_only=True), np.zeros((3000, 0)), dt=0.02, sigma_y=1e-2,
        disturbances={"v": push}, substeps=2, seed=1,
    )  # fmt: skip
    ekf = bs.EKF(
        bs.Noise(sigma_y=1e-2, sigma_w={"v": WALK}),
        bs.Prior(sigma_x0={"q": 0.1, "v": 0.5, "k": 6.0}, x0={"k": 27.0}),
    )
    (expected,) = bs.check.check_identifiability(ekf, MODEL, recording).parameters
    found = bs.estimate(ekf, MODEL, recording, engine="vm").isel(time=-1).sel(state="k")
    assert expected.std == pytest.approx(float(found.x_std), rel=1e-6)
    assert expected.std < 0.2 * expected.prior
    assert abs(float(found.x_hat) - 30.0) < 3 * expected.std

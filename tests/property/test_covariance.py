"""Which propagation of the covariance keeps it positive, and what is said when it does not."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from backsight.discrete.noise import random_walk
from backsight.discrete.runge_kutta import TABLEAUS, Integrator
from backsight.engine.recursion import Channel
from backsight.estimators import EKF, MHO, AbstractEstimator, Noise, Prior
from backsight.estimators.kalman.prediction import predict
from backsight.estimators.parts.covariance import packed
from backsight.estimators.scaled import setting
from backsight.models.lti import lti
from backsight.schema import Status
from oracles.stage import DT as STAGE_DT
from oracles.stage import HEUN, NOISE, PRIOR, SIGMA_W, joint, recording
from relations.linear import Run

HARD = Noise(sigma_y=1e-3, Qc=random_walk(SIGMA_W * [0.1, 1, 1, 1, 1, 1], dt=STAGE_DT))
VOLTAGE = np.array([1.976, 2.642, 3.231, 3.694, 3.991, 4.101, 4.018, 3.750, 3.320, 2.765])
POSITION = np.array([-5.716, -6.192, -6.218, -5.793, -4.948, -3.743, -2.264, -0.616, 1.083, 2.713])
"""Ten samples of the stage in full motion (V and um), on which a long step hurts."""

TRIANGLE = Channel("P", ("state", "state_"), symmetric=True)


@settings(max_examples=40)
@given(
    scheme=st.sampled_from(sorted(TABLEAUS)),
    substeps=st.integers(1, 4),
    hold=st.sampled_from(["zoh", "foh"]),
    covariance=st.sampled_from(["transition", "discrete"]),
    exponent=st.floats(-6, 2),
    seed=st.integers(0, 2**32 - 1),
    ranks=st.tuples(st.integers(0, 3), st.integers(0, 3)),
)
def test_positive_at_every_step_size(scheme, substeps, hold, covariance, exponent, seed, ranks):
    """Steps from far too fine to far too long, stable or not, P and Q singular or not."""
    rng = np.random.default_rng(seed)
    F, dt = 5 * rng.standard_normal((3, 3)), 10.0**exponent
    P, Q = (
        L @ L.T for L in (rng.standard_normal((3, rank)) * [[1.0], [1e-3], [1e2]] for rank in ranks)
    )
    model = lti(
        F, np.ones((3, 1)), np.ones((1, 3)),
        states=dict.fromkeys("abc", ""), inputs={"u": ""}, outputs={"y": ""},
    )  # fmt: skip
    s = setting(model, dt, noise=Noise(sigma_y=1.0, Qc=Q), prior=Prior(P0=P))
    ahead = predict(s, Integrator(scheme, substeps, hold), covariance)
    _, triangle = ahead(np.zeros(3), packed(s.P0), 0.3, -0.2)
    P_next = TRIANGLE.unpack(np.asarray(triangle).T)[0]
    assert np.all(np.isfinite(P_next))
    assert np.linalg.eigvalsh(P_next)[0] >= -1e-13 * np.trace(P_next)


def test_covariance_equation_loses_it_at_a_long_step():
    """One Euler step on the covariance equation of a stiff damper: P + h (Z P + P Z') < 0."""
    model = lti([[-30.0]], [[0.0]], [[1.0]], states={"v": ""}, inputs={"u": ""}, outputs={"y": ""})
    s = setting(model, 0.02, noise=Noise(sigma_y=1.0), prior=Prior(1.0))
    euler = Integrator("euler", 1)
    _, by_equation = predict(s, euler, "ode")(0.0, 1.0, 0.0, 0.0)
    _, by_transition = predict(s, euler, "transition")(0.0, 1.0, 0.0, 0.0)
    assert float(by_equation) == pytest.approx(1 - 2 * 0.6)
    assert float(by_transition) == pytest.approx((1 - 0.6) ** 2)


def test_the_known_trap_is_reported():
    """The stage with a tenth of the paper's process noise on the position.

    Heun's method on the covariance equation then gives an indefinite P at the third sample. The
    status must say so there, and the estimates must not become something that is no number.
    """
    for make in (EKF, MHO):
        result = trapped(make(HARD, PRIOR, integrator=HEUN, covariance="ode"))
        indefinite = np.flatnonzero(smallest_eigenvalue(result["P"]) < -1e-9)
        raised = np.flatnonzero(result["status"] == Status.NOT_POSITIVE_DEFINITE)
        assert indefinite[0] == raised[0] == 2
        assert np.all(np.isfinite(result["x_hat"]))


def test_the_default_has_no_trap():
    for make in (EKF, MHO):
        result = trapped(make(HARD, PRIOR, integrator=HEUN))
        assert smallest_eigenvalue(result["P"]).min() > 0
        assert not (result["status"].astype(int) & int(Status.NOT_POSITIVE_DEFINITE)).any()


def trapped(estimator: AbstractEstimator) -> dict[str, np.ndarray]:
    """Run on the short recording, repeated so that the observer's window is full."""
    u, y = np.tile(VOLTAGE, 3)[:, None], np.tile(POSITION, 3)[:, None]
    return Run(estimator, joint(), STAGE_DT)(u, y)


def test_the_tuning_of_the_paper_stays_positive():
    u, _, y = recording(400, seed=1)
    result = Run(EKF(NOISE, PRIOR, HEUN, "ode"), joint(), STAGE_DT)(u[:, None], y[:, None])
    assert smallest_eigenvalue(result["P"]).min() > 0
    assert not result["status"].any()


def smallest_eigenvalue(P: np.ndarray) -> np.ndarray:
    """Of the correlation matrix of every sample; negative diagonals stay negative."""
    size = np.sqrt(np.abs(np.einsum("kii->ki", P)))
    return np.linalg.eigvalsh(P / (size[:, :, None] * size[:, None, :]))[:, 0]

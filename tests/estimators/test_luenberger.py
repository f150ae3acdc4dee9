"""Placed poles, and the two forms of the same observer."""

import numpy as np
import pytest

from backsight.errors import TuningError
from backsight.estimators.kalman import Luenberger
from backsight.estimators.uncertainty import Noise, Prior
from backsight.models.lti import lti
from relations.linear import DT, P0, X0, A, B, C, Q, R, Run, model, record

GAUSSIANS = {"noise": Noise(R=R, Q=Q), "prior": Prior(P0=P0, x0=X0)}
POLES = (0.3 + 0.2j, 0.3 - 0.2j, 0.5)


@pytest.mark.parametrize("form", ["filtering", "prediction"])
@pytest.mark.parametrize("poles", [POLES, (0.2, 0.2, 0.7)])
def test_error_has_the_poles(form, poles):
    found = Luenberger(**GAUSSIANS, poles=poles, form=form).observer(model(), DT)
    np.testing.assert_allclose(
        np.sort_complex(found.eigenvalues), np.sort_complex(poles), atol=1e-7
    )
    seen = C @ A if form == "filtering" else C
    physical = np.linalg.eigvals(A - found.gain @ seen)
    np.testing.assert_allclose(np.sort_complex(physical), np.sort_complex(poles), atol=1e-7)


def test_prints_its_eigenvalues():
    text = str(Luenberger(**GAUSSIANS, poles=POLES).observer(model(), DT))
    assert "filtering form" in text
    assert "error eigenvalue 0.3+0.2j: modulus 0.360555, fades with 0.098 s" in text


@pytest.mark.parametrize("form", ["filtering", "prediction"])
def test_recursion_and_covariance(form):
    """Written out, with samples that are missing; the covariance is that of the error."""
    u, y = record(40, seed=1, missing=0.3)
    estimator = Luenberger(**GAUSSIANS, poles=POLES, form=form)
    gain = estimator.observer(model(), DT).gain
    result = Run(estimator, model(), DT)(u, y)
    x, P, eye = X0, P0, np.eye(3)
    for k in range(40):
        e, K = np.nan_to_num(y[k] - C @ x), gain * np.isfinite(y[k])
        np.testing.assert_allclose(result["e"][k], e, rtol=1e-9, atol=1e-11)
        np.testing.assert_allclose(result["S"][k], C @ P @ C.T + R, rtol=1e-9)
        if form == "filtering":
            x, P = x + K @ e, (eye - K @ C) @ P @ (eye - K @ C).T + K @ R @ K.T
        np.testing.assert_allclose(result["x_hat"][k], x, rtol=1e-9, atol=1e-11)
        np.testing.assert_allclose(result["P"][k], P, rtol=1e-9, atol=1e-12)
        if form == "filtering":
            x, P = A @ x + B @ u[k], A @ P @ A.T + Q
        else:
            x = A @ x + B @ u[k] + K @ e
            P = (A - K @ C) @ P @ (A - K @ C).T + K @ R @ K.T + Q


@pytest.mark.parametrize("hold", ["zoh", "foh"])
def test_with_one_output_both_forms_are_one_observer(hold):
    """L = A L~; the prediction is the same, the filtering form only uses y a sample earlier."""
    plant = lti([[0.0, 1.0], [-30.0, -0.8]], [[0.0], [2.0]], [[1.0, 0.0]], [[0.4]],
                states={"q": "", "v": ""}, inputs={"f": ""}, outputs={"y": ""})  # fmt: skip
    rng = np.random.default_rng(2)
    u, y = rng.standard_normal((40, 1)), rng.standard_normal((40, 1))
    forms = [
        Run(Luenberger(Noise(0.1, 0.01), Prior(1.0), poles=(0.4, 0.6), form=f, hold=hold), plant,
            DT)(u, y)
        for f in ("filtering", "prediction")
    ]  # fmt: skip
    np.testing.assert_allclose(forms[0]["e"], forms[1]["e"], rtol=1e-9, atol=1e-11)
    np.testing.assert_allclose(forms[0]["S"], forms[1]["S"], rtol=1e-9)
    assert not np.allclose(forms[0]["x_hat"], forms[1]["x_hat"])


def test_singular_transition_needs_the_prediction_form():
    delay = lti([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]], dt=DT,
                states={"a": "", "b": ""}, inputs={"u": ""}, outputs={"y": ""})  # fmt: skip
    settings = {"noise": Noise(0.1), "prior": Prior(1.0), "poles": (0.1, 0.2)}
    with pytest.raises(TuningError, match="use form = 'prediction'"):
        Luenberger(**settings).compile(delay, DT)
    found = Luenberger(**settings, form="prediction").observer(delay, DT)
    np.testing.assert_allclose(np.sort(found.eigenvalues.real), [0.1, 0.2], atol=1e-9)


@pytest.mark.parametrize(
    ("poles", "message"),
    [
        ((0.1, 0.2, 1.0), "pole 1 is not inside the unit circle"),
        ((0.1, 0.2 + 0.1j, 0.3), r"pole 0\.2\+0\.1j has no conjugate partner; add 0\.2-0\.1j"),
        ((0.1, 0.2), "2 poles are given for 3 states"),
        ((0.1, 0.1, 0.1), r"pole 0\.1 is given 3 times; with 2 outputs at most 2"),
    ],
)
def test_wrong_poles(poles, message):
    with pytest.raises(TuningError, match=message):
        Luenberger(**GAUSSIANS, poles=poles).compile(model(), DT)


def test_hidden_states_are_named():
    hidden = lti(np.diag([0.9, 0.8]), np.zeros((2, 0)), [[1.0, 0.0]], dt=DT,
                 states={"seen": "", "unseen": ""}, inputs={}, outputs={"y": ""})  # fmt: skip
    with pytest.raises(TuningError, match="do not see unseen"):
        Luenberger(Noise(0.1), Prior(1.0), poles=(0.1, 0.2)).compile(hidden, DT)
    with pytest.raises(TuningError, match="unknown form 'filter'"):
        Luenberger(Noise(0.1), Prior(1.0), poles=(0.1, 0.2), form="filter")

"""Machine code does the same as the virtual machine in the branches that few samples take."""

import numpy as np
import pytest

from backsight.engine import native, vm
from backsight.estimators import KalmanFilter, Limit, LinearMHE, Luenberger, Noise, Prior
from backsight.estimators import RecursiveMHE as Recursive
from backsight.models.lti import lti
from backsight.schema import Status
from closeness import assert_close
from relations.linear import DT, P0, X0, B, C, Q, R, model, record

DECAYING = np.array([[0.9, 0.3, 0.0], [-0.4, 0.8, 0.1], [0.0, 0.0, 0.9]])
PLANT = lti(DECAYING, B, C, states=dict.fromkeys("abc", ""), inputs={"f": "", "g": ""},
            outputs={"y": "", "z": ""}, dt=DT)  # fmt: skip
BOUNDED = model(((-1.0, 0.9), (-np.inf, np.inf), (-np.inf, np.inf)))
NOISY, EXACT, PRIOR = Noise(R=R, Q=Q), Noise(R=R), Prior(P0=P0, x0=X0)
LIMITS = (
    Limit("residual", {"z": 1.0}, lower=-0.3, upper=0.3, of="residual"),
    Limit("place", {"y": 1.0}, upper=0.3, of="residual"),
    Limit("sum", {"a": 1.0, "c": 0.5}, upper=0.7),
    Limit("push", {"b": 1.0}, lower=-0.02, of="noise"),
)
CASES = {
    "steady": (KalmanFilter(NOISY, PRIOR, steady_state=True), PLANT),
    "arrival": (LinearMHE(NOISY, PRIOR, N=4, arrival_weight=0.5), PLANT),
    "limits": (LinearMHE(NOISY, PRIOR, N=4, limits=LIMITS), BOUNDED),
    "sliding": (Recursive(EXACT, PRIOR, N=4, alpha=0.6, reinitialise=7), PLANT),
    "prediction": (Luenberger(NOISY, PRIOR, poles=(0.4, 0.5, 0.6), form="prediction"), PLANT),
}


@pytest.mark.parametrize("name", CASES)
def test_native_is_the_virtual_machine(name):
    estimator, plant = CASES[name]
    u, y = record(80, seed=7, missing=0.15)
    y[30:45] = np.nan
    recursion = estimator.compile(plant, DT)
    data = [u, np.nan_to_num(y), np.isfinite(y).astype(float)]
    end, expected = vm.run(recursion, data, carry=recursion.carry0)
    carry, outputs = native.run(recursion, data, carry=recursion.carry0)
    for output, reference in zip([carry, *outputs], [end, *expected], strict=True):
        assert_close(output, reference, 1e-9)


def test_the_recording_leads_into_every_branch():
    """Gaps that leave the state open, limits that hold, and limits that contradict the data."""
    estimator, plant = CASES["limits"]
    u, y = record(80, seed=7, missing=0.15)
    y[30:45] = np.nan
    recursion = estimator.compile(plant, DT)
    data = [u, np.nan_to_num(y), np.isfinite(y).astype(float)]
    _, outputs = vm.run(recursion, data, carry=recursion.carry0)
    raised = np.bitwise_or.reduce(outputs[5][:, 0].astype(int))
    for bit in (Status.CLIPPED, Status.UNOBSERVED, Status.INFEASIBLE):
        assert raised & int(bit), bit

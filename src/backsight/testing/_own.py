"""One line for each of our estimators: what it is asked for by the contract."""

import numpy as np

from backsight.estimators import (
    AHG,
    EKF,
    HGO,
    IEKF,
    MHE,
    MHO,
    UKF,
    CompressiveSensingMHE,
    JointInput,
    KalmanFilter,
    LinearMHE,
    Luenberger,
    RecursiveMHE,
)
from backsight.solvers.box import GaussNewton
from backsight.testing.case import Build, Case


def _linear(build: Build, *, outputs: tuple[str, ...] = ("position", "speed")) -> Case:
    """Case of an estimator for linear models."""
    return Case(build, k_known=True, outputs=outputs, exact=True)


CASES: dict[str, Case] = {
    "ekf": Case(lambda on, integrator: EKF(on.noise, on.prior, integrator=integrator)),
    "iekf": Case(lambda on, integrator: IEKF(on.noise, on.prior, integrator=integrator)),
    # The observer uses the measurements of its window in the filters and in the cost, but counts
    # them once in P. With alpha = 1 its mean NIS is 3 to 5 % too high for that reason; with
    # alpha = 0.1 the effect is below the width of the chi-square band used here.
    "mho": Case(
        lambda on, integrator: MHO(on.noise, on.prior, N=5, alpha=0.1, integrator=integrator)
    ),
    "mhe": Case(
        lambda on, integrator: MHE(
            on.noise, on.prior, N=2, integrator=integrator, optimiser=GaussNewton(2, tolerance=0.0)
        )
    ),
    "ukf": Case(lambda on, integrator: UKF(on.noise, on.prior, integrator=integrator)),
    "hgo": Case(
        lambda on, integrator: HGO(on.noise, on.prior, gain=15.0, integrator=integrator),
        k_known=True,
        outputs=("position",),
    ),
    "ahg": Case(
        lambda on, integrator: AHG(
            on.noise, on.prior, gain=15.0, Gamma=np.array(500 / on.length**2), integrator=integrator
        ),
        outputs=("position",),
    ),
    "kf": _linear(lambda on, integrator: KalmanFilter(on.noise, on.prior, hold=integrator.hold)),
    "lmhe": _linear(
        lambda on, integrator: LinearMHE(on.noise, on.prior, N=8, hold=integrator.hold)
    ),
    # A gain that was computed for two outputs is not the one for the first of them.
    "rmhe": _linear(
        lambda on, integrator: RecursiveMHE(on.noise, on.prior, N=8, hold=integrator.hold),
        outputs=("position",),
    ),
    "luenberger": _linear(
        lambda on, integrator: Luenberger(
            on.noise, on.prior, poles=(0.7 + 0.2j, 0.7 - 0.2j), hold=integrator.hold
        ),
        outputs=("position",),
    ),
    # The innovation is that of a motion without the unknown force, which is zero here.
    "joint_input": _linear(
        lambda on, integrator: JointInput(
            on.noise, on.prior, forces=("push",), hold=integrator.hold
        )
    ),
    # The weight is so large that the noise is not taken for a force.
    "csmhe": _linear(
        lambda on, integrator: CompressiveSensingMHE(
            on.noise,
            on.prior,
            forces=("push",),
            lam=100 / on.length,
            N=6,
            lag=0,
            hold=integrator.hold,
        )
    ),
}
"""Every estimator of the package by its key."""

"""Which estimators hold the truth on which plants, and why some are not asked."""

import dataclasses
from collections.abc import Callable, Mapping

import backsight as bs
from backsight.estimators import arrival
from backsight.estimators.base import AbstractEstimator
from bands.plants import Plant, damping, oscillator, pendulum, slope

PLANTS: Mapping[str, Callable[[], Plant]] = {
    "oscillator": oscillator,
    "pendulum": pendulum,
    "known pendulum": lambda: pendulum(known=True),
    "slope": slope,
    "damping": damping,
}

LINEAR = "for linear models only"
KNOWN = "keeps parameters at their start values; asked with the known pendulum"
CHAIN = "for chains of integrators in continuous time only"


@dataclasses.dataclass(frozen=True)
class Row:
    """An estimator, in one setting.

    Parameters
    ----------
    kind : str
        Key of the estimator.
    build : callable
        For a plant.
    why_not : dict
        Plants that it is not asked for, each with the reason.
    forces : {"none", "any", "hits"}
        Unknown forces that act on the plant.
    """

    kind: str
    build: Callable[[Plant], AbstractEstimator]
    why_not: Mapping[str, str] = dataclasses.field(default_factory=dict)
    forces: str = "none"


def window(**settings: object) -> Row:
    """Moving horizon estimation with process noise."""
    return Row("mhe", lambda on: bs.MHE(on.noise, on.prior, N=8, **settings))


def sparse(**settings: object) -> Row:
    """Compressive-sensing moving horizon estimation."""
    return Row(
        "csmhe",
        lambda on: bs.CompressiveSensingMHE(
            on.noise, on.prior, forces=("push",), lam=0.15, N=8, **settings
        ),
        {**NONLINEAR, "slope": "refuses bounds of states"},
        forces="hits",
    )


NONLINEAR = {"pendulum": LINEAR, "known pendulum": LINEAR, "damping": LINEAR}

ROWS: Mapping[str, Row] = {
    "kf": Row("kf", lambda on: bs.KalmanFilter(on.noise, on.prior), NONLINEAR),
    "ekf": Row("ekf", lambda on: bs.EKF(on.noise, on.prior)),
    "iekf": Row("iekf", lambda on: bs.IEKF(on.noise, on.prior)),
    "ukf": Row("ukf", lambda on: bs.UKF(on.noise, on.prior)),
    "mho": Row("mho", lambda on: bs.MHO(on.noise, on.prior, N=8)),
    "mhe": window(),
    "mhe, with a lag": window(lag=4),
    "mhe, EKF arrival": window(arrival=arrival.EKFArrival()),
    "mhe, UKF arrival": window(arrival=arrival.UKFArrival()),
    "mhe, constant arrival": window(arrival=arrival.ConstantArrival()),
    "mhe, no arrival": window(arrival=arrival.NoArrival()),
    "lmhe": Row("lmhe", lambda on: bs.LinearMHE(on.noise, on.prior, N=8), NONLINEAR),
    "lmhe, half an arrival": Row(
        "lmhe",
        lambda on: bs.LinearMHE(on.noise, on.prior, N=8, arrival_weight=0.5),
        {**NONLINEAR, "slope": "holds 99.95 %: a bound that is imposed only takes errors away"},
    ),
    "lmhe, whole arrival": Row(
        "lmhe", lambda on: bs.LinearMHE(on.noise, on.prior, N=8, arrival_weight=1.0), NONLINEAR
    ),
    "rmhe": Row("rmhe", lambda on: bs.RecursiveMHE(on.noise, on.prior, N=8), NONLINEAR),
    "luenberger": Row(
        "luenberger",
        lambda on: bs.Luenberger(on.noise, on.prior, poles=(0.8 + 0.1j, 0.8 - 0.1j)),
        NONLINEAR,
    ),
    "hgo": Row(
        "hgo",
        lambda on: bs.HGO(on.noise, on.prior, gain=20.0),
        {"pendulum": KNOWN, "damping": KNOWN, "slope": CHAIN},
    ),
    "ahg": Row(
        "ahg",
        lambda on: bs.AHG(on.noise, on.prior, gain=20.0, Gamma=10.0),
        {"slope": CHAIN},
    ),
    "joint_input": Row(
        "joint_input",
        lambda on: bs.JointInput(on.noise, on.prior, forces=("push",)),
        {**NONLINEAR, "slope": "one sensor cannot tell a force from the slope"},
        forces="any",
    ),
    "csmhe": sparse(),
    "csmhe, naive arrival": sparse(arrival=arrival.SmoothedArrival(naive=True)),
}
"""``SmoothedArrival(naive=True)`` is missing: it counts data twice, as its page says (97 %)."""

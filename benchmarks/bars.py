"""The figures that Backsight promises, and whether they are reached."""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from benchmarks import (
    beam_contests,
    call_contests,
    contests,
    fit_contests,
    noise_contests,
    scaling,
    sizes,
    startup,
)
from benchmarks.contest import Row
from benchmarks.process_noise import ACTIVE, BOUNDS, FREE, INACTIVE
from benchmarks.scaling import Point
from benchmarks.startup import Startup
from benchmarks.struck_beam import CASES


@dataclasses.dataclass(frozen=True)
class Bar:
    """A figure to reach.

    Parameters
    ----------
    name : str
        Says also whether the bar is a least or a largest value.
    value : float or None
        None if it could not be measured.
    bar : float
    met : bool
    """

    name: str
    value: float | None
    bar: float
    met: bool


@dataclasses.dataclass(frozen=True)
class Measured:
    """What a run measured."""

    rows: Sequence[Row]
    startups: Sequence[Startup]
    points: Sequence[Point]

    def time(self, contest: str, name: str) -> float:
        """Least time of a contender; NaN if it could not take part."""
        return next(r.best for r in self.rows if (r.contest, r.name) == (contest, name))

    def difference(self, contest: str, name: str) -> float:
        """Difference of a contender from the expected results; NaN if it could not take part."""
        return next(r.difference for r in self.rows if (r.contest, r.name) == (contest, name))

    def startup(self, name: str) -> float:
        """Median time of something that happens once [s]."""
        return next(s.median for s in self.startups if s.name == name)


def bars(measured: Measured) -> list[Bar]:
    """All figures to reach, ratios within the same run."""
    time = measured.time
    native = time(contests.OBSERVER, contests.NATIVE)

    def ratio(contest: str, name: str, ours: str = contests.NATIVE) -> float:
        return time(contest, name) / time(contest, ours)

    def large(contest: str) -> float:
        return time(contest, contests.NATIVE) / time(contest, contests.NUMPY)

    return [
        *_least(
            {
                "MHO: native against virtual machine [times faster]": (
                    ratio(contests.OBSERVER, contests.VIRTUAL),
                    15,
                ),
                "MHO: native against CasADi's own C, gcc -O3, buffer [times faster]": (
                    ratio(contests.OBSERVER, contests.GENERATED),
                    1.7,
                ),
                "MHO: native, whole sample, against do-mpc MHE, same N [times faster]": (
                    time(contests.WINDOW, contests.DO_MPC)
                    / time(contests.WINDOW, contests.WHOLE_SAMPLE),
                    700,
                ),
                "MHO: 8 lanes, one core, against scalar program [times the throughput]": (
                    native / time(contests.OBSERVER, contests.LANES),
                    5,
                ),
                "UKF: native against filterpy [times faster]": (
                    ratio(contests.UNSCENTED, contests.FILTERPY),
                    100,
                ),
                "LMHE with limits: native against OSQP from Python [times faster]": (
                    ratio(contests.LIMITED, contests.OSQP),
                    5,
                ),
                **_noise_ratios(measured),
                **_beam_ratios(measured),
                **_fit_ratios(measured),
            }
        ),
        *_most(
            {
                "KF: against the best peer [times as long]": (sizes.worst(measured.rows), 1),
                "MHO: from Python, whole recording [us per sample]": (native, 8),
                "MHO: iterated to convergence [us per sample]": (
                    time(contests.OBSERVER, contests.CONVERGED),
                    12,
                ),
                "EKF: 6 states, 8 sub-steps [us per sample]": (
                    time(contests.FILTERS, contests.EKF_ODE),
                    0.5,
                ),
                "UKF: 5 states, 4 sub-steps [us per sample]": (
                    time(contests.FILTERS, contests.UKF),
                    2,
                ),
                "AHG: fixed gain [us per sample]": (time(contests.FILTERS, contests.AHG_FIXED), 1),
                "AHG: adaptive gain [us per sample]": (
                    time(contests.FILTERS, contests.AHG_ADAPTIVE),
                    5,
                ),
                "LMHE: 4 states, N = 20, no limits [us per sample]": (
                    time(contests.FILTERS, contests.FREE),
                    1,
                ),
                "LMHE: 5 states, N = 20, limits [us per sample]": (
                    time(contests.LIMITED, contests.NATIVE),
                    30,
                ),
                "LMHE: the same, samples missing [us per sample]": (
                    time(contests.LIMITED, contests.GAPS),
                    30,
                ),
                "LMHE: the same, difference from OSQP [scaled states]": (
                    measured.difference(contests.LIMITED, contests.OSQP),
                    1e-8,
                ),
                **_noise_times(measured),
                **_beam_times(measured),
                "Tuning: difference from statsmodels [share of a standard deviation]": (
                    measured.difference(fit_contests.DEVIATIONS, fit_contests.STATSMODELS),
                    1e-4,
                ),
                "EKF: a call with 2000 samples, all in [ms]": (
                    time(call_contests.CALL, call_contests.ESTIMATE),
                    1.5,
                ),
                "EKF: a call with 100 000 samples, against its loop [times as long]": (
                    time(call_contests.WHOLE, call_contests.ESTIMATE)
                    / time(call_contests.WHOLE, call_contests.LOOP),
                    1.5,
                ),
                "EKF: 60 states, row of masses, against NumPy with BLAS [times as long]": (
                    large(contests.CHAIN),
                    3,
                ),
                "EKF: 60 states, dense, against NumPy with BLAS [times as long]": (
                    large(contests.DENSE),
                    3,
                ),
                "EKF: 60 states, row of masses, compile [s]": (
                    measured.startup(startup.compiling("chain")),
                    5,
                ),
                "EKF: 60 states, dense, compile [s]": (
                    measured.startup(startup.compiling("dense")),
                    5,
                ),
                "MHO: emit and compile [s]": (measured.startup(startup.compiling("observer")), 1),
                "MHO: from the cache [s]": (measured.startup(startup.from_cache("observer")), 0.05),
                "import backsight [s]": (measured.startup("import backsight"), 0.6),
                "backsight --help [s]": (measured.startup("backsight --help"), 1),
            }
        ),
    ]


Figures = dict[str, tuple[float, float]]


def _noise_ratios(measured: Measured) -> Figures:
    """Process noise: how many times faster than general solvers, all of them converged."""
    table = noise_contests.title(INACTIVE)
    ours = measured.time(table, noise_contests.CONVERGED)
    peers = {
        "do-mpc (IPOPT)": (noise_contests.DO_MPC, 200),
        "CasADi with fatrop": (noise_contests.FATROP, 30),
        "CasADi with hpipm": (noise_contests.HPIPM, 30),
    }
    return {
        f"MHE, process noise: converged, against {name} [times faster]": (
            measured.time(table, peer) / ours,
            bar,
        )
        for name, (peer, bar) in peers.items()
    }


def _noise_times(measured: Measured) -> Figures:
    """Process noise: times, difference from the minimiser, growth, many states."""
    limits = {FREE: 15, INACTIVE: 25, ACTIVE: 60}
    differences = [
        measured.difference(noise_contests.title(bounds), noise_contests.CONVERGED)
        for bounds in BOUNDS
    ]
    growth = scaling.exponent(measured.points, scaling.WINDOW, scaling.ESTIMATOR)
    large = measured.time(noise_contests.title(INACTIVE), noise_contests.LARGE)
    return {
        **{
            f"MHE, process noise: {bounds} [us per sample]": (
                measured.time(noise_contests.title(bounds), noise_contests.TWO),
                bar,
            )
            for bounds, bar in limits.items()
        },
        "MHE, process noise: difference from IPOPT [scaled states]": (_worst(differences), 1e-8),
        "MHE, process noise: exponent of the time against N": (growth, 1.1),
        "MHE, process noise: 30 states, N = 20 [ms per sample]": (1e-3 * large, 5),
    }


def _fit_ratios(measured: Measured) -> Figures:
    """Tuning: how many times faster the same optimum is found."""
    return {
        f"Tuning: {what}against {name} [times faster]": (
            measured.time(table, name) / measured.time(table, ours),
            10,
        )
        for what, table, ours, name in (
            ("", fit_contests.DEVIATIONS, fit_contests.BACKSIGHT, fit_contests.STATSMODELS),
            ("first fit, ", fit_contests.DEVIATIONS, fit_contests.FIRST, fit_contests.STATSMODELS),
            ("", fit_contests.COVARIANCE, fit_contests.BACKSIGHT, fit_contests.KALMAN_PY),
        )
    }


def _beam_ratios(measured: Measured) -> Figures:
    """Sparse forces: how many times faster, in the worst of the four cases."""

    def least(peer: str) -> float:
        tables = map(beam_contests.title, CASES)
        shares = [measured.time(t, beam_contests.NATIVE) / measured.time(t, peer) for t in tables]
        return 1 / _worst(shares)

    name = "CS-MHE: Algorithm 1 against {}, worst case [times faster]"
    return {
        name.format("CVXPY with Clarabel"): (least(beam_contests.CLARABEL), 250),
        name.format("OSQP"): (least(beam_contests.OSQP), 30),
    }


def _beam_times(measured: Measured) -> Figures:
    """Sparse forces: time and difference in the worst of the four cases."""
    tables = [beam_contests.title(case) for case in CASES]
    times = [measured.time(table, beam_contests.NATIVE) for table in tables]
    differences = [measured.difference(table, beam_contests.OSQP) for table in tables]
    return {
        "CS-MHE: Algorithm 1, worst case of Table 3 [us per window]": (_worst(times), 30),
        "CS-MHE: forces, difference from OSQP, worst case [N]": (_worst(differences), 1e-8),
    }


def _worst(values: Sequence[float]) -> float:
    """The largest; NaN if one is missing."""
    return float(np.max(values))


def _least(figures: Figures) -> list[Bar]:
    return _judged(figures, "at least", lambda value, bar: value >= bar)


def _most(figures: Figures) -> list[Bar]:
    return _judged(figures, "at most", lambda value, bar: value <= bar)


def _judged(figures: Figures, word: str, reached: Callable[[float, float], bool]) -> list[Bar]:
    return [
        Bar(
            name=f"{name}, {word}",
            value=float(f"{value:.4g}") if np.isfinite(value) else None,
            bar=bar,
            met=bool(np.isfinite(value) and reached(value, bar)),
        )
        for name, (value, bar) in figures.items()
    ]

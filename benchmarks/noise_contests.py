"""Who competes on moving horizon estimation with process noise."""

from functools import partial

from backsight.solvers.box import GaussNewton
from benchmarks import process_noise
from benchmarks.contest import Contender, Contest, Entry, peer
from benchmarks.peers import shooting_nlp
from benchmarks.problems import TWICE
from benchmarks.process_noise import ACTIVE, BOUNDS, INACTIVE

TWO = "Backsight, 2 iterations, whole sample"
CONVERGED = "Backsight, to convergence, whole sample"
IPOPT = "CasADi IPOPT"
FATROP = "CasADi fatrop"
HPIPM = "CasADi sqpmethod, hpipm"
DO_MPC = "do-mpc (IPOPT), same windows"
LARGE = "Backsight, 30 states, window of 21 samples, 2 iterations"


def title(bounds: str) -> str:
    """Of the table with these bounds."""
    return f"Moving horizon estimation with process noise, {bounds}"


def contests() -> tuple[Contest, ...]:
    """One table for every kind of bounds."""
    return tuple(map(_contest, BOUNDS))


def _contest(bounds: str) -> Contest:
    solvers = {IPOPT: "ipopt", FATROP: "fatrop", HPIPM: "hpipm"}
    others = [Entry(n, peer("shooting_nlp", "build", bounds, s)) for n, s in solvers.items()]
    entries = [
        Entry(TWO, partial(_native, bounds, TWICE)),
        Entry(CONVERGED, partial(_native, bounds, GaussNewton())),
        *others,
        Entry(DO_MPC, peer("do_mpc_noise", "on_windows", bounds)),
    ]
    if bounds == INACTIVE:
        entries.append(Entry(LARGE, process_noise.large))
    return Contest(title(bounds), "us per sample or window", tuple(entries), REMARKS[bounds])


REMARKS = {
    process_noise.FREE: "6 states, window of 16 samples, 4 Heun sub-steps, process noise on every "
    "state, arrival cost with constant covariance. Difference at the end of a window from IPOPT "
    "with the tightest tolerance.",
    INACTIVE: "Stiffness, damping and gain are not negative. The difference of the line with 30 "
    "states, a row of masses without bounds, is that from the Kalman filter.",
    ACTIVE: "The gain must be larger than it is: in the samples with the payload.",
}


def _native(bounds: str, optimiser: GaussNewton) -> Contender:
    return process_noise.native_engine(bounds, optimiser, shooting_nlp.minimisers(bounds))

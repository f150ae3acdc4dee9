"""Who competes on sparse forces."""

from functools import partial

from benchmarks import struck_beam
from benchmarks.contest import Contest, Entry, peer
from benchmarks.struck_beam import CASES

NATIVE = "Backsight, complete Algorithm 1"
CLARABEL = "CVXPY with Clarabel"
CLARABEL_TIGHT = "CVXPY with Clarabel, tight tolerances"
OSQP = "OSQP, warm start, condensed dual"

TIGHT = dict.fromkeys(("tol_gap_abs", "tol_gap_rel", "tol_feas"), 1e-13)
"""With Clarabel's own, forces are wrong by some 1e-3 N."""


def title(case: float) -> str:
    """Of the table for this error of the model."""
    return f"Compressive-sensing window, frequencies of the model {case:+g} %"


def contests() -> tuple[Contest, ...]:
    """One table for every model of Table 3."""
    return tuple(map(_contest, CASES))


def _contest(case: float) -> Contest:
    return Contest(
        title(case),
        "us per window",
        (
            Entry(NATIVE, partial(struck_beam.native_engine, case)),
            Entry(CLARABEL, peer("clarabel_l1", "build", case, {})),
            Entry(CLARABEL_TIGHT, peer("clarabel_l1", "build", case, TIGHT)),
            Entry(OSQP, peer("osqp_l1", "build", case)),
        ),
        REMARK if case == CASES[0] else "",
    )


REMARK = (
    "6 states, 3 sensors, 8 places for forces, 11 samples, the values of Table 3 and expected "
    "forces with extra states; all 51 full windows of the recording. Backsight's line has "
    "everything: arrival cost, forces, covariances, what the next window expects. The others are "
    "given all that and find the forces. Difference of Backsight from the other engine, of the "
    "others from Backsight, in N."
)

"""What the paper says, each statement decided by the measured numbers."""

import numpy as np

from backsight.types import Array
from backsight_studies.beam import evaluate
from backsight_studies.beam.evaluate import counts, kept, window_mse
from backsight_studies.beam.experiment import Experiment
from backsight_studies.beam.plant import HITS, THICKNESS, N, forces
from backsight_studies.beam.sweeps import Q_EXPONENTS
from backsight_studies.beam.tuning import (
    NO_CARRYOVER,
    READING_1,
    READING_3,
    SETTINGS,
    TABLE,
    THRESHOLD,
)
from backsight_studies.claims import Claim

CONVERGED = 0.25
"""Largest relative deviation of the sum of all forces of a window from the hit in it."""

WORST = -10.0
TABLE_3 = "Table 3"


def judge(e: Experiment) -> list[Claim]:
    """Decide every statement of sections 4.2 to 4.4."""
    return [
        _observability(e),
        _impossible(e),
        *_minimum(e),
        _line(e),
        _logarithmic(e),
        _best_weight(e),
        _accurate(e),
        _grows(e),
        _largest(e),
        _link(e),
        _sums(e),
        _peaks(e),
        *_correction(e),
        _prior(e),
        _sparsity(e),
    ]


def shares(alpha: Array) -> list[float]:
    """Sum of all forces of the last window that contains a hit, as a share of the hit."""
    sums = alpha.sum(axis=(1, 2))
    return [float(sums[hit.step] / hit.size) for hit in HITS]


def near_hit(window: int) -> str:
    """Name the hits that a window contains."""
    inside = [f"F{i}" for i, hit in enumerate(HITS, 1) if window <= hit.step < window + N]
    return " and ".join(inside) or "no hit"


def _by_mismatch(values: dict[float, str]) -> str:
    return ", ".join(f"{m:g} %: {v}" for m, v in values.items())


def _observability(e: Experiment) -> Claim:
    most = 6 + int(e.locations.attrs["most"])
    found = f"rank = number of states up to {most}, in either order; {e.locations.attrs['verdict']}"
    return Claim(
        "With a random walk at every place the system is not observable beyond 9 states",
        "h = 3 mm",
        most == 9,
        found,
    )


def _impossible(e: Experiment) -> Claim:
    reached = {m: f"{v:.1e} 1/N for lam = {TABLE[m].lam:.1e}" for m, v in e.identity.items()}
    return Claim(
        "eps_Q scales a covariance of the process noise: of the states, Q = eps_Q I",
        "Table 3; mass-normalised modes",
        all(v > TABLE[m].lam for m, v in e.identity.items()),
        f"nothing is found from {_by_mismatch(reached)}: it must scale B B', forces at the nodes",
    )


def _minimum(e: Experiment) -> list[Claim]:
    text = "The error has a minimum over lam: too small a weight does not exploit sparsity"
    found = []
    for (mismatch, sigma), curve in e.curves.items():
        inner = curve.mse[0] > 1.01 * curve.mse.min() < curve.mse[-1]
        best = f"{curve.mse.min():.2g} N² at lam = e^{np.log(curve.best * 1e10):.3g} 1e-10"
        left = f"{curve.mse[0]:.2g} N² at the smallest weight"
        setting = f"{mismatch:g} %, {noise_name(sigma)}"
        found.append(Claim(text, setting, bool(inner), f"{best}; {left}"))
    return found


def noise_name(sigma: float) -> str:
    """In words."""
    return f"noise of {1e6 * sigma:g} µm" if sigma else "no noise"


def _line(e: Experiment) -> Claim:
    inside = {m: _inside(drawn.mse) for m, drawn in e.maps.items() if m}
    spread = {m: f"{d.mse.max() / d.mse.min():.2g}" for m, d in e.maps.items() if m}
    return Claim(
        "With a model error the error is least along a line in the log-log plane of eps_Q, eps_R",
        "no noise, best lam everywhere",
        e.scaling < 1e-8 and all(inside.values()),
        f"only eps_Q / eps_R counts (to {e.scaling:.0e} N), so lines of constant error there are; "
        "but without noise the error falls with eps_Q / eps_R up to the edge of the map "
        f"({sum(inside.values())} of {len(inside)} maps have their least error inside); largest "
        f"per least error {_by_mismatch(spread)}",
    )


def _inside(mse: Array) -> bool:
    """Whether the least error of a map is not where eps_Q / eps_R is largest."""
    return bool(np.unravel_index(mse.argmin(), mse.shape) != (mse.shape[0] - 1, 0))


def _logarithmic(e: Experiment) -> Claim:
    drawn = e.maps[WORST]
    slopes = np.diff(np.log(np.diagonal(drawn.lam)))
    steps = Q_EXPONENTS[1] - Q_EXPONENTS[0]
    return Claim(
        "Along such a line the optimal lam scales logarithmically",
        f"{WORST:g} %",
        bool(np.allclose(slopes, -steps)),
        f"lam is as 1 / eps_R: slope {slopes.mean() / steps:.3f} in the log-log plane, exactly",
    )


def _best_weight(e: Experiment) -> Claim:
    best = e.curves[WORST, 0.0].best / TABLE[WORST].lam
    return Claim(
        "lam of Table 3 is that of the least error",
        f"{WORST:g} %, no noise, no carryover",
        0.9 < best < 1.1,
        f"the best weight is {best:.2g} times that of the table; the error there is "
        f"{e.curves[WORST, 0.0].mse.min():.3g} N² instead of "
        f"{e.cases[TABLE_3, NO_CARRYOVER, WORST].score.mse:.3g} N²",
    )


def _accurate(e: Experiment) -> Claim:
    reference = e.cases[TABLE_3, READING_1, 0.0].score
    worst = max(abs(a - h.size) for a, h in zip(reference.recovered, HITS, strict=True))
    return Claim(
        "Without a model error the estimate is very accurate",
        "Table 3, reading I",
        worst < 0.1 and reference.false == 0,
        f"all four hits to {worst:.2g} N, {reference.false} false ones",
    )


def _grows(e: Experiment) -> Claim:
    mse = {m: e.cases[TABLE_3, READING_1, m].score.mse for m in THICKNESS}
    return Claim(
        "The error grows with the model error",
        "Table 3, reading I",
        list(mse.values()) == sorted(mse.values()),
        f"MSE {_by_mismatch({m: f'{v:.3g} N²' for m, v in mse.items()})}; with one setting for all "
        + _by_mismatch(
            {m: f"{e.cases['one setting', READING_1, m].score.mse:.3g} N²" for m in THICKNESS}
        ),
    )


def largest_window(alpha: Array) -> int:
    """Number of the window with the largest error."""
    return int(window_mse(alpha, forces()).argmax())


def _largest(e: Experiment) -> Claim:
    windows = {m: largest_window(e.cases[TABLE_3, READING_1, m].windows.alpha) for m in THICKNESS}
    first = HITS[0].step
    return Claim(
        "The largest errors belong to F1",
        "Table 3, reading I",
        all(first - N < i <= first for i in windows.values()),
        _by_mismatch({m: f"window {i} ({near_hit(i)})" for m, i in windows.items()}),
    )


def _link(e: Experiment) -> Claim:
    correlation = {}
    for m in THICKNESS:
        alpha = e.cases[TABLE_3, READING_1, m].windows.alpha
        correlation[m] = np.corrcoef(counts(alpha), window_mse(alpha, forces()))[0, 1]
    return Claim(
        "A window in which more components are detected has a larger error",
        "Table 3, reading I",
        all(c > 0.5 for m, c in correlation.items() if m),
        f"correlation {_by_mismatch({m: f'{c:.2f}' for m, c in correlation.items()})}",
    )


def _sums(e: Experiment) -> Claim:
    found = shares(e.cases[TABLE_3, READING_1, WORST].windows.alpha)
    near = [abs(share - 1) < CONVERGED for share in found]
    shown = ", ".join(f"F{i} {100 * share:.0f} %" for i, share in enumerate(found, 1))
    return Claim(
        "The sums of F1 and F3 converge to the hits, those of F2 and F4 do not",
        f"Table 3, reading I, {WORST:g} %",
        near == [True, False, True, False],
        f"last window of each hit: {shown} of it",
    )


def _peaks(e: Experiment) -> Claim:
    found = e.cases[TABLE_3, READING_1, WORST].score
    all_four = all(abs(v) >= 2 * THRESHOLD for v in found.recovered)
    return Claim(
        "With 10 % model error all four hits are found; a threshold of 2 N leaves one false one",
        f"Table 3, reading I, {WORST:g} %",
        all_four and found.false_large == 1,
        f"{', '.join(f'{v:.2f}' for v in found.recovered)} N at the true places and times; "
        f"{found.false} false ones of 1 N or more, {found.false_large} of 2 N or more",
    )


def _correction(e: Experiment) -> list[Claim]:
    found = []
    for setting in SETTINGS:
        errors = {m: corrected(e, setting, m) for m in THICKNESS}
        shown = {m: f"{a:.2g} to {b:.2g}" for m, (a, b) in errors.items()}
        found.append(
            Claim(
                "Spreading what is below the threshold over the hits makes up for the loss",
                f"{setting}, reading I, amplitude rule",
                all(b < a for a, b in errors.values()),
                f"MSE of the output [N²] {_by_mismatch(shown)}",
            )
        )
    return found


def corrected(e: Experiment, setting: str, mismatch: float) -> tuple[float, float]:
    """MSE of the output above the threshold, without and with the amplitude rule [N2]."""
    output, d = e.cases[setting, READING_1, mismatch].windows.output, forces()
    corrected = evaluate.amplitude_rule(output)
    return evaluate.output_mse(kept(output), d), evaluate.output_mse(corrected, d)


def _prior(e: Experiment) -> Claim:
    def gain(reading: str) -> dict[float, str]:
        without = {m: e.cases["one setting", NO_CARRYOVER, m].score.relative for m in THICKNESS}
        ratio = {m: e.cases["one setting", reading, m].score.relative / without[m] for m in without}
        return {m: f"{v:.2f}" for m, v in ratio.items()}

    first, third = gain(READING_1), gain(READING_3)
    return Claim(
        "Expecting the forces of the last window (eq. 13) makes the estimate better",
        "one setting, reading I",
        all(float(v) < 1 for v in first.values()),
        f"relative error per that without: reading I {_by_mismatch(first)}; "
        f"reading III {_by_mismatch(third)}",
    )


def _sparsity(e: Experiment) -> Claim:
    ratio = {m: e.ridge[m] / e.cases["one setting", NO_CARRYOVER, m].score.mse for m in THICKNESS}
    return Claim(
        "Sparsity is what makes forces at more places than sensors observable",
        "one setting; the l1 norm against squares with their best weight",
        all(v > 2 for v in ratio.values()),
        "MSE with squares per MSE with l1 "
        + _by_mismatch({m: f"{v:.1f}" for m, v in ratio.items()}),
    )

"""The page of the study."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from backsight.rounding import significant
from backsight_studies import html
from backsight_studies.check_tables import required_table
from backsight_studies.checks import Check
from backsight_studies.lecture.experiment import ALPHAS, Experiment

TITLE = "Least-squares moving horizon estimation: the lecture, worked through"

CORRECTIONS = (
    "A window of N transitions holds N + 1 samples. The last block row of the observability matrix "
    "of the window is therefore C A^N, not C A^(N-1).",
    "The first block row of the matrix of the inputs is zero, since the first sample of the window "
    "depends on no input in it; the block in row i and column j is C A^(i-1-j) B for i > j.",
    "The gains are M = A^N (Phi'Phi)^-1 Phi' and N_u = F - M Gamma; the letter N stands for the "
    "gain and for the horizon.",
    "With alpha = 1 the recursion is exact, but its error evolves with the inverse of the "
    "transition matrix: for every stable plant it is unstable.",
)

CAPTIONS = {
    "batch": "Every m-th sample is measured; batch form. The state shown is never measured.",
    "recursive": "The same in the recursive form with alpha = 1, while it is still exact.",
    "alpha": "Between the Kalman-type observer (alpha = 0) and the exact window (alpha = 1), "
    "started again every 20 samples; right: why that is needed.",
    "rounding": "Rounding errors of the recursion with alpha = 1 in the two-state example.",
    "increments": "An unknown input of 2 begins at sample 40; the incremental model is wrong only "
    "while the step is in the window.",
    "limits": "The unknown force on the second mass: bounds that are known to hold make its "
    "estimate better.",
}


def build(experiment: Experiment, checks: Sequence[Check], figures: Mapping[str, Path]) -> str:
    """The whole page as HTML."""
    sections = [
        (name.capitalize(), html.picture(figures[name], caption))
        for name, caption in CAPTIONS.items()
    ]
    sections += [
        ("Corrections to the text", html.items(*CORRECTIONS)),
        ("Checks", required_table(checks)),
    ]
    lead = html.items(*short(experiment, checks))
    source = (
        "Sources: Ling, Lim, “Receding horizon recursive state estimation”, IEEE Transactions on "
        "Automatic Control, 1999; Ling, Wu, Lim, “State observers for single rate and multirate "
        "controllers”, IFAC 1996. The plants of the lecture's figures are not given; ours are a "
        "two-state example and two masses in a row."
    )
    return html.page(TITLE, sections, lead=lead, foot=html.text(source))


def short(experiment: Experiment, checks: Sequence[Check]) -> list[str]:
    """The study in a few sentences."""
    free, bounded = experiment.limited.rmse
    a = experiment.alpha
    best = min(range(len(ALPHAS)), key=lambda i: a.rmse[i])
    unstable = next(w for w, s in zip(ALPHAS, a.modulus, strict=True) if s >= 1)
    early, late = experiment.rounding[10], experiment.rounding[250]
    return [
        f"{sum(c.passed for c in checks)} of {len(checks)} checks are met.",
        f"With noise in plant and sensor the recursion is best at alpha = {ALPHAS[best]:g}, "
        f"{significant(a.rmse[best] / a.kalman, 4)} times the error of the Kalman filter; it is "
        f"unstable from alpha = {unstable:g} on.",
        f"The rounding error of the recursion with alpha = 1 grows from {early:.0e} at sample 10 "
        f"to {late:.2g} at sample 250.",
        f"Bounds on the unknown force make its rms error {significant(free / bounded, 4)} times "
        f"smaller: {bounded:.3g} N instead of {free:.3g} N.",
    ]

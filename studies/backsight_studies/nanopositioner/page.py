"""The page of the study: every sentence with a number gets it from the experiment."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from backsight.estimators import MHO
from backsight.rounding import significant
from backsight_studies import html
from backsight_studies.checks import Check
from backsight_studies.html import Cell
from backsight_studies.nanopositioner import remarks
from backsight_studies.nanopositioner.claims import CLAIMS, Verdict
from backsight_studies.nanopositioner.evaluate import START_UP, Measures, speed_floor
from backsight_studies.nanopositioner.expected import TABLE_I
from backsight_studies.nanopositioner.experiment import SCENARIOS, Experiment, compared
from backsight_studies.nanopositioner.spread import Spread, ratio, spread
from backsight_studies.nanopositioner.tuning import (
    ALPHA,
    CONVERGED,
    PAPER_RULE,
    PAPER_RULE_NEWTON,
    RETUNED,
    SIGMA_Y,
    TRUSTING,
)

TITLE = "Nanopositioner: moving horizon observer against extended Kalman filter"


def build(
    experiment: Experiment,
    verdicts: Sequence[Verdict],
    checks: Sequence[Check],
    figures: Mapping[str, Path],
) -> str:
    """The whole page as HTML."""
    simulated = any(s in SCENARIOS for s in experiment.scenarios)
    sections = [
        ("The experiment", html.text(*remarks.SETUP)),
        ("Table I of the paper, and ours", _table_one(experiment)),
        ("Accuracy, convergence and consistency", _truth_table(experiment)),
        ("Why RSE x1 is not accuracy", _accuracy(experiment)),
        ("Which statements hold", _claims(experiment, verdicts)),
    ]
    if simulated:
        sections.append(("Solver and tuning", _solvers(experiment)))
    sections.append((f"Figures: {experiment.shown.label}", _figures(figures)))
    if simulated:
        sections.append(("The weight of the window", _weight(experiment, figures["alpha"])))
    sections += [
        ("How ambiguities and misprints were read", html.items(*remarks.READINGS)),
        ("Checks", _checks(checks)),
    ]
    lead = html.text(remarks.LEAD) + html.items(*short(experiment, verdicts, checks))
    return html.page(TITLE, sections, lead=lead, foot=html.text(remarks.SOURCE, remarks.LIMITS))


def short(
    experiment: Experiment, verdicts: Sequence[Verdict], checks: Sequence[Check]
) -> list[str]:
    """The study in a few sentences, for the page and the terminal."""
    points = []
    for prefix, what in (
        ("independent implementation", "numbers of an independent implementation are met"),
        ("Table I", "improvements over the EKF in Table I have the size of the paper's"),
    ):
        those = [c for c in checks if c.name.startswith(prefix)]
        if those:
            points.append(f"{sum(c.passed for c in those)} of {len(those)} {what}.")
    for scenario in experiment.scenarios:
        count = len(experiment.trials(scenario))
        everywhere = f" on all {count} recordings" if count > 1 else ""
        for solver in (PAPER_RULE, CONVERGED):
            those = [v for v in verdicts if (v.scenario, v.solver) == (scenario, solver)]
            failed = [v.claim.short for v in those if not v.passed]
            line = f"{scenario}, {solver}: {len(those) - len(failed)} of {len(those)} statements "
            line += f"of the paper hold{everywhere}"
            points.append(line + (f"; not: {', '.join(failed)}." if failed else "."))
    return points


def _table_one(experiment: Experiment) -> str:
    head = [
        "estimator", "RSE x1 [10⁻³ µm]", "per EKF", "RSE x2 [10³ µm/s]", "per EKF",
        f"RSE x2 after {START_UP} samples", "per EKF",
    ]  # fmt: skip
    ekf = TABLE_I["EKF"]
    rows: list[list[str | Cell]] = []
    for method, (x1, x2) in TABLE_I.items():
        numbers = (1e3 * x1, x1 / ekf[0], 1e-3 * x2, x2 / ekf[1])
        rows.append([method, *(significant(n, 4) for n in numbers), "–", "–"])
    parts = [html.table(head, rows, caption="The paper, on measured data")]
    for scenario in experiment.scenarios:
        rows = []
        for variant in compared():
            row: list[str | Cell] = [variant.label]
            for field, factor in (("rse_x1", 1e3), ("rse_x2", 1e-3), ("rse_x2_settled", 1e-3)):
                row.append(_cell(spread(experiment, scenario, variant.label, field), factor))
                row.append(_cell(ratio(experiment, scenario, variant.label, field), 1.0))
            rows.append(row)
        parts.append(html.table(head, rows, caption=_caption(experiment, scenario)))
    return html.text(remarks.TABLE_ONE) + "".join(parts)


def _truth_table(experiment: Experiment) -> str:
    columns = (
        ("rms_v", "true speed error, rms [µm/s]", 1.0),
        ("rms_v_transient", "the same, 20 ms after the removal", 1.0),
        ("k_time", "k/m within 2 % after [ms]", 1.0),
        ("std_k", "std of k/m [%]", 100.0),
        ("std_b", "std of b/m [%]", 100.0),
        ("std_c", "std of c/m [%]", 100.0),
        ("step_k", "step to step, k/m [10⁻⁴]", 1e4),
        ("nis", "mean NIS", 1.0),
        ("evaluations", "evaluations per sample", 1.0),
    )
    parts = []
    for scenario in experiment.scenarios:
        rows: list[list[str | Cell]] = [
            [
                variant.label,
                *(
                    _cell(spread(experiment, scenario, variant.label, field), factor)
                    for field, _, factor in columns
                ),
            ]
            for variant in compared()
        ]
        head = ["estimator", *(name for _, name, _ in columns)]
        parts.append(html.table(head, rows, caption=_caption(experiment, scenario)))
    return html.text(*remarks.TRUTH) + "".join(parts)


def _accuracy(experiment: Experiment) -> str:
    of = _first(experiment, experiment.shown.scenario)
    same = [of[v.label].rms_q for v in compared()]
    S = experiment.results["EKF"]["S"].values[START_UP:, 0, 0]
    share = float(np.median(SIGMA_Y**2 / S))
    floor = speed_floor(experiment.shown.stage)
    errors = [of[v.label].rse_x1 for v in compared()]
    settled, whole = of["EKF"].rse_x2_settled, of["EKF"].rse_x2
    points = [
        "RSE x1 compares x1 with the measurement that the estimator has just used. That difference "
        f"is (1 − K1) times the innovation, and 1 − K1 = R/S is {share:.2g} here (median of the "
        f"EKF, {experiment.shown.label}): it says how closely an estimator follows the noise of "
        "the sensor.",
        f"RSE x1 of the estimators differs by a factor of {max(errors) / min(errors):.2g}, but "
        f"against the true displacement they have rms errors of {1e3 * min(same):.4g} to "
        f"{1e3 * max(same):.4g} nm.",
        f"In RSE x2 the true speed itself would get {floor:.0f} µm/s, because eq. 39 makes a sine "
        f"of 450 Hz smaller by 1.3 %: that is {100 * floor / settled:.0f} % of the EKF's value "
        "after start-up.",
        f"The first {START_UP} samples, where the parameters are still wrong, raise the EKF's "
        f"RSE x2 from {settled:.0f} to {whole:.0f} µm/s.",
    ]
    if TRUSTING in of:
        points.insert(
            1,
            "An EKF that believes in a tenth of the sensor's variance has "
            f"{of[TRUSTING].rse_x1 / of['EKF'].rse_x1:.2f} times the RSE x1, but "
            f"{of[TRUSTING].rms_v / of['EKF'].rms_v:.3f} times the true speed error and "
            f"{of[TRUSTING].rms_q / of['EKF'].rms_q:.3f} times the true displacement error.",
        )
    return html.items(*points)


def _claims(experiment: Experiment, verdicts: Sequence[Verdict]) -> str:
    columns = [(s, solver) for s in experiment.scenarios for solver in (PAPER_RULE, CONVERGED)]
    found = {(v.claim.text, v.scenario, v.solver): v for v in verdicts}
    rows: list[list[str | Cell]] = []
    for claim in CLAIMS:
        row: list[str | Cell] = [claim.text]
        for scenario, solver in columns:
            v = found[claim.text, scenario, solver]
            word = "yes" if v.passed else "no" if v.holds == 0 else "not always"
            row.append(Cell(f"{word}, {v.holds} of {v.of}", good=v.passed))
        rows.append(row)
    head = ["statement", *(f"{scenario}, {solver}" for scenario, solver in columns)]
    return html.text(remarks.CLAIMS) + html.table(head, rows)


def _solvers(experiment: Experiment) -> str:
    parts = [html.text(*remarks.SOLVERS)]
    for scenario in (s for s in SCENARIOS if s in experiment.scenarios):
        of = _first(experiment, scenario)
        solvers = (CONVERGED, PAPER_RULE_NEWTON, PAPER_RULE)
        labels = ["EKF", RETUNED, *(f"{method}, {s}" for method in ALPHA for s in solvers)]
        rows: list[list[str | Cell]] = [
            [
                label,
                _digits(1e3 * of[label].rse_x1),
                _digits(of[label].rms_v),
                _digits(of[label].k_time),
                _digits(100 * of[label].std_k),
                _digits(of[label].evaluations),
            ]
            for label in labels
        ]
        head = [
            "estimator", "RSE x1 [10⁻³ µm]", "true speed error, rms [µm/s]",
            "k/m within 2 % after [ms]", "std of k/m [%]", "evaluations per sample",
        ]  # fmt: skip
        parts.append(html.table(head, rows, caption=f"{scenario}, first seed"))
        parts.append(html.items(*(_stopped(of, method) for method in ALPHA)))
    return "".join(parts)


def _stopped(of: Mapping[str, Measures], method: str) -> str:
    """How far the paper's rule ends from the minimum."""
    minimum, newton, bfgs = (
        of[f"{method}, {solver}"].rse_x1 for solver in (CONVERGED, PAPER_RULE_NEWTON, PAPER_RULE)
    )
    return (
        f"{method}: against the minimum, the paper's rule changes RSE x1 by "
        f"{100 * (newton / minimum - 1):+.1f} % with Gauss-Newton steps and by "
        f"{100 * (bfgs / minimum - 1):+.0f} % with BFGS, where it is "
        f"{bfgs / of['EKF'].rse_x1:.2f} times that of the EKF."
    )


def _figures(figures: Mapping[str, Path]) -> str:
    return "".join(
        html.picture(figures[name], caption) for name, caption in remarks.CAPTIONS.items()
    )


def _weight(experiment: Experiment, file: Path) -> str:
    points = []
    for scenario in (s for s in SCENARIOS if s in experiment.scenarios):
        observers = {
            r.variant.estimator.alpha: r.measures
            for r in experiment.rows
            if r.trial is _first_trial(experiment, scenario)
            and r.variant.solver == CONVERGED
            and isinstance(r.variant.estimator, MHO)
        }
        best = min(observers, key=lambda alpha: observers[alpha].rms_v)
        fastest = min(observers, key=lambda alpha: _never_last(observers[alpha].k_time))
        quietest = min(observers, key=lambda alpha: observers[alpha].std_k)
        points.append(
            f"{scenario}: the true speed error is smallest at α = {best:g} "
            f"({observers[best].rms_v:.3g} µm/s), k/m converges fastest at α = {fastest:g} "
            f"({observers[fastest].k_time:.3g} ms) and scatters least at α = {quietest:g} "
            f"({100 * observers[quietest].std_k:.2g} %)."
        )
    return html.items(*points) + html.picture(file, remarks.SWEEP)


def _checks(checks: Sequence[Check]) -> str:
    rows: list[list[str | Cell]] = [
        [
            c.name,
            Cell("yes" if c.passed else "no", good=c.passed),
            c.paper if isinstance(c.paper, str) else f"{c.paper:.8g}",
            c.measured if isinstance(c.measured, str) else f"{c.measured:.8g}",
            str(c.tolerance),
        ]
        for c in checks
        if not c.name.startswith("claim") or "horizon" in c.name
    ]
    return html.table(["check", "met", "expected", "measured", "relative tolerance"], rows)


def _first_trial(experiment: Experiment, scenario: str) -> object:
    return next(r.trial for r in experiment.rows if r.trial.scenario == scenario)


def _first(experiment: Experiment, scenario: str) -> dict[str, Measures]:
    """Measures on the first recording of a scenario, by label."""
    return experiment.trials(scenario)[0]


def _never_last(value: float) -> float:
    return math.inf if math.isnan(value) else value


def _caption(experiment: Experiment, scenario: str) -> str:
    count = len(experiment.trials(scenario))
    what = {
        "nominal": "nominal: the model has the structure of the plant",
        "mode2": "mode2: the plant has a second mode at 1100 Hz that no model knows",
    }.get(scenario, f"recording {scenario}")
    return f"{what}; mean and range of {count} recordings" if count > 1 else what


def _cell(s: Spread, factor: float) -> Cell:
    if math.isnan(s.mean):
        return Cell("–")
    note = "" if s.low == s.high else f"{_digits(factor * s.low)} … {_digits(factor * s.high)}"
    return Cell(_digits(factor * s.mean), note)


def _digits(value: float) -> str:
    return significant(value, 3)

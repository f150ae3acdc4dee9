"""What the paper says of its experiment, and the numbers to meet."""

import numpy as np

from backsight_studies.beam.evaluate import kept
from backsight_studies.beam.plant import N
from backsight_studies.beam.tuning import READING_1, READING_3
from backsight_studies.beam_experiment.experiment import (
    EXACT,
    NOISE,
    STEPS,
    Experiment,
    delay,
    elsewhere,
    neighbour,
)
from backsight_studies.beam_experiment.plant import FREQUENCIES, NODE, PRINTED, impulse
from backsight_studies.checks import Check
from backsight_studies.claims import Claim

MEASURED = next(iter(FREQUENCIES))

PEAKS = (6.8, 6.2)
MEAN_NUMBER = 0.57
"""Independent implementation, no noise, reading I: both outputs [N], mean number of forces."""

L0_PEAKS = (9.0, 8.7)
"""The same of the l0 norm, under noise [N]."""


def deviation(row: tuple[float, float, float]) -> float:
    """Of the model from the measured frequency [%]."""
    measured, modelled, _ = row
    return 100 * (modelled / measured - 1)


def judge(e: Experiment) -> list[Claim]:
    """Decide the statements of section 5."""
    return [_table(), _found(e), *_third(e), *_approach(e), _delay(e)]


def _table() -> Claim:
    off = {f"f{i}": (row[2], deviation(row)) for i, row in enumerate(PRINTED, 1)}
    shown = ", ".join(f"{k} printed {a:g} %, computed {b:.2f} %" for k, (a, b) in off.items())
    fitting = PRINTED[1][1] / (1 + PRINTED[1][2] / 100)
    return Claim(
        "The deviations in Table 4 are those of its frequencies",
        "Table 4",
        all(abs(a - b) < 0.05 for a, b in off.values()),
        f"{shown}; a deviation of −3.71 % would need f2 = {fitting:.2f} Hz",
    )


def _found(e: Experiment) -> Claim:
    peaks = kept(e.output(MEASURED, NOISE, READING_3))[:, list(STEPS), NODE]
    share = float((peaks != 0).all(axis=1).mean())
    return Claim(
        "The hammer is found at its place, at both steps",
        f"{MEASURED}, 10 µm noise, reading III",
        share == 1.0,
        f"in {100 * share:.0f} % of {len(peaks)} recordings; mean "
        f"{peaks.mean(axis=0)[0]:.2f} and {peaks.mean(axis=0)[1]:.2f} N for 8 N each",
    )


def _third(e: Experiment) -> list[Claim]:
    found = []
    for reading in (READING_1, READING_3):
        with_error, without = (
            float(neighbour(e.output(beam, NOISE, reading)).mean()) for beam in (MEASURED, EXACT)
        )
        clean = int(elsewhere(e.output(MEASURED, 0.0, reading))[0])
        found.append(
            Claim(
                "A third component at 0.365 m shows that the hammer moved towards that node",
                f"{MEASURED}, 10 µm noise, {reading}",
                with_error < 0.1,
                f"here the hammer does not move, and the component is there in "
                f"{100 * with_error:.0f} % of the recordings ({100 * without:.0f} % without model "
                f"error; without noise {clean} components off the hammer)",
            )
        )
    return found


def _approach(e: Experiment) -> list[Claim]:
    found = []
    first, last = STEPS[1] + 1 - N, STEPS[0]
    for name, noise, reading in (("no noise", 0.0, READING_1), ("10 µm noise", NOISE, READING_3)):
        mse = e.mse(MEASURED, noise, reading).mean(axis=0)
        found.append(
            Claim(
                "The estimate gets better as the hit approaches the beginning of the window",
                f"{MEASURED}, {name}, {reading}",
                bool(mse[last] < 0.9 * mse[first]),
                f"MSE {mse[first]:.2g} N² in the first window that contains all of the hit, "
                f"{mse[last]:.2g} N² in the last",
            )
        )
    return found


def _delay(e: Experiment) -> Claim:
    late = [delay(w) for w in e.windows[MEASURED, NOISE, READING_3]]
    return Claim(
        "A hit is detected with some delay",
        f"{MEASURED}, 10 µm noise, reading III",
        float(np.mean(late)) > 0,
        f"both forces are shown {min(late)} to {max(late)} samples (mean {np.mean(late):.1f}) "
        "after the first sample that both have moved",
    )


def checks(e: Experiment, claims: list[Claim]) -> list[Check]:
    """Numbers of an independent implementation, and the statements of the paper."""
    output = e.output(MEASURED, 0.0, READING_1)
    rows = []
    for step, wanted in zip(STEPS, PEAKS, strict=True):
        found = float(output[0, step, NODE])
        rows.append(
            Check(
                f"no noise, reading I: force at step {step} [N]", wanted, found, "within 0.05",
                abs(found - wanted) <= 0.05, "outputs.csv",
            )
        )  # fmt: skip
    off = int(elsewhere(output)[0])
    rows.append(
        Check("no noise, reading I: other forces", 0, off, "equal", off == 0, "outputs.csv")
    )
    mean = float(e.number(MEASURED, 0.0, READING_1).mean())
    rows.append(
        Check(
            "no noise, reading I: mean number of forces per window", MEAN_NUMBER, mean,
            "within 0.005", abs(mean - MEAN_NUMBER) <= 0.005, "outputs.csv",
        )
    )  # fmt: skip
    for beam in FREQUENCIES:
        forces = np.array(e.l0[beam, NOISE])
        exact = float((elsewhere(forces) == 0).mean())
        rows.append(
            Check(
                f"l0, 10 µm noise: share of recordings with nothing off the hammer, {beam}",
                1.0, exact, "at least 0.9", exact >= 0.9, "outputs.csv",
            )
        )  # fmt: skip
    forces = np.array(e.l0[MEASURED, NOISE])
    for step, wanted in zip(STEPS, L0_PEAKS, strict=True):
        found = float(forces[:, step, NODE].mean())
        rows.append(
            Check(
                f"l0, 10 µm noise: mean force at step {step} [N]", wanted, found, "within 0.3",
                abs(found - wanted) <= 0.3, "outputs.csv",
            )
        )  # fmt: skip
    total = float(forces[:, list(STEPS), NODE].sum(axis=1).mean())
    rows.append(
        Check(
            "l0, 10 µm noise: mean impulse [N times the sampling period]", impulse(), total,
            "within 3 %", abs(total / impulse() - 1) <= 0.03, "outputs.csv",
        )
    )  # fmt: skip
    return [
        *rows,
        *(
            Check(f"claim: {c.text} ({c.setting})", "holds", c.measured, "holds", c.holds, "page")
            for c in claims
        ),
    ]

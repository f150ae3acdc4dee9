"""The page of the study."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from backsight_studies import html
from backsight_studies.beam.plant import THICKNESS
from backsight_studies.beam.remarks import SOURCE
from backsight_studies.beam_random.experiment import Experiment
from backsight_studies.beam_random.scenarios import CALIBRATED, L0, PAPER
from backsight_studies.check_tables import expected_table
from backsight_studies.checks import Check
from backsight_studies.claims import tally

TITLE = "A beam struck at random: which way to find the hits is the best"

SETUP = (
    "The cantilever of the study “beam”, hit four times: places and moments at random, at least "
    "four steps apart, 3 to 12 N of random sign; 10 µm of noise in every sensor, 61 samples. The "
    "models are 0, −3.3, −6.7 and −10 % off in all frequencies, and in their masses. A hit counts "
    "if it is found at the right step and place, of the right sign and with 1 N or more; F1 is the "
    "harmonic mean of the share of the hits that are found and of the share of what is found that "
    "are hits, averaged over the recordings.",
    "Four methods decide window by window, with a delay of 10 samples; the others wait until the "
    "recording has ended. The weights of every method were chosen on other scenarios with the "
    "truth known; l0 needs none but the noise of the sensors. Calibration finds the three "
    "frequencies from the recording itself, with no knowledge of the hits: those with which the "
    "fewest forces explain it. The masses stay wrong; hence the error of the sizes that remains.",
)

LESSONS = (
    "Under noise the expectation of eq. 13, read as a prior on the same forces, does harm: it "
    "holds on to first guesses, which are at the newest steps of the window, where places cannot "
    "be told apart yet. Waiting until a force was seen in four samples (the age gate) mends that.",
    "What looks like missed and false hits with a wrong model is mostly its frequencies; these can "
    "be had from the recording, and then the four mismatches give the same.",
)

CAPTIONS = {
    "methods": "Means over the recordings.",
    "frequencies": "Calibrated frequencies of every recording, relative to the true ones.",
}

FIELDS = {
    "f1": "F1",
    "f1_near": "F1, one step and place off are right",
    "false_alarms": "false alarms per recording",
    "magnitude": "relative error of the sizes",
}


def build(e: Experiment, checks: Sequence[Check], figures: Mapping[str, Path]) -> str:
    """The whole page as HTML."""
    pictures = "".join(html.picture(figures[k], c) for k, c in CAPTIONS.items())
    sections = [
        ("The experiment", html.text(*SETUP)),
        ("What was found", "".join(_table(e, *field) for field in FIELDS.items())),
        ("Figures", pictures),
        ("What to take from it", html.items(*LESSONS)),
        ("Checks", expected_table(checks)),
    ]
    return html.page(TITLE, sections, lead=html.items(*short(e, checks)), foot=html.text(SOURCE))


def short(e: Experiment, checks: Sequence[Check]) -> list[str]:
    """The study in a few sentences, for the page and the terminal."""
    paper, best = (
        ", ".join(f"{e.mean(method, m, 'f1'):.2f}" for m in THICKNESS)
        for method in (PAPER, L0 + CALIBRATED)
    )
    off = max(float(np.median(np.abs(errors))) for errors in e.detuning.values())
    return [
        tally(checks),
        f"F1 over {len(next(iter(e.outcomes.values())))} recordings for a mismatch of "
        f"{', '.join(f'{m:g}' for m in THICKNESS)} %: {paper} with the paper's method; {best} with "
        "the l0 norm and frequencies calibrated from the recording itself.",
        f"Calibration finds the frequencies to {100 * off:.2g} % (median).",
    ]


def _table(e: Experiment, field: str, name: str) -> str:
    methods = dict.fromkeys(method for method, _ in e.outcomes)
    rows = [[k, *(f"{e.mean(k, m, field):.2f}" for m in THICKNESS)] for k in methods]
    return html.table(["method", *(f"{m:g} %" for m in THICKNESS)], rows, caption=name)

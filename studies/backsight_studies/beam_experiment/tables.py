"""The numbers of the study as a CSV file."""

from pathlib import Path

from backsight_studies.beam.plant import NODES
from backsight_studies.beam_experiment.experiment import Experiment
from backsight_studies.sheets import write_sheet


def write_tables(e: Experiment, out: Path) -> None:
    """Write ``outputs.csv``: every force that a method found."""
    head = ["beam", "noise_m", "method", "recording", "step", "place_m", "force_N"]
    named = {(b, s, f"window, {r}"): e.output(b, s, r) for b, s, r in e.windows}
    named |= {(b, s, "l0"): found for (b, s), found in e.l0.items()}
    rows: list[list[object]] = []
    for key, outputs in named.items():
        for i, found in enumerate(outputs):
            for step, node in zip(*found.nonzero(), strict=True):
                rows.append([*key, i, int(step), NODES[node], float(found[step, node])])
    write_sheet(out / "outputs.csv", head, rows)

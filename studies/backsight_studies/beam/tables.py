"""The numbers of the study as CSV files."""

from collections.abc import Sequence
from pathlib import Path

from backsight_studies.beam import expected
from backsight_studies.beam.experiment import Experiment
from backsight_studies.beam.plant import HITS
from backsight_studies.beam.sweeps import Q_EXPONENTS, R_EXPONENTS
from backsight_studies.claims import Claim, write_claims
from backsight_studies.sheets import write_sheet


def write_tables(e: Experiment, claims: Sequence[Claim], out: Path) -> None:
    """Write ``frequencies``, ``cases``, ``noise``, ``curves``, ``map`` and ``claims.csv``."""
    write_sheet(
        out / "frequencies.csv",
        ["mismatch_percent", "mode", "frequency_Hz", "paper_Hz"],
        [
            [m, i + 1, float(f), expected.PAPER_FREQUENCIES[m][i]]
            for m, found in e.frequencies.items()
            for i, f in enumerate(found)
        ],
    )
    write_sheet(
        out / "cases.csv",
        ["setting", "reading", "mismatch_percent", "mse_N2", "relative_error", "false_1N",
         "false_2N", *(f"F{i}_N" for i in range(1, len(HITS) + 1)), "kkt"],
        [
            [*key, c.score.mse, c.score.relative, c.score.false, c.score.false_large,
             *c.score.recovered, float(c.windows.kkt.max())]
            for key, c in e.cases.items()
        ],
    )  # fmt: skip
    write_sheet(
        out / "noise.csv",
        ["reading", "mismatch_percent", "seed", "false_1N"],
        [[*key, seed, count] for key, found in e.noisy.items() for seed, count in found.items()],
    )
    write_sheet(
        out / "curves.csv",
        ["mismatch_percent", "noise_m", "lam_per_N", "mse_N2"],
        [
            [*key, float(lam), float(mse)]
            for key, curve in e.curves.items()
            for lam, mse in zip(curve.lam, curve.mse, strict=True)
        ],
    )
    write_sheet(
        out / "map.csv",
        ["mismatch_percent", "ln_eps_Q_1e2", "ln_eps_R_1e10", "mse_N2", "best_lam_per_N"],
        [
            [m, j, k, float(drawn.mse[a, b]), float(drawn.lam[a, b])]
            for m, drawn in e.maps.items()
            for a, j in enumerate(Q_EXPONENTS)
            for b, k in enumerate(R_EXPONENTS)
        ],
    )
    write_claims(claims, out)

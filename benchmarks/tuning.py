"""How well the tuner finds the noise of ten machines: ``python -m benchmarks.tuning``.

Every machine is recorded with ten seeds and tuned from standard deviations of which those of the
sensors are the root of 10, those of the process 10 times wrong, either way: R by 10, Q by 100. What
was found is judged on another recording of the same machine.
"""

import argparse
import dataclasses
import time
from collections.abc import Sequence

import numpy as np
import xarray as xr

import backsight as bs
from backsight.analysis.consistency import log_likelihood, mean_nis, nis_band
from backsight.tune import fit
from benchmarks.tuning_problems import MACHINES, Machine

SEEDS = 10
WRONG_Y, WRONG_W = 10**0.5, 10.0
"""Factors of the standard deviations at the start."""


@dataclasses.dataclass(frozen=True)
class Trial:
    """One fit, judged on its own recording and on one that it has not seen.

    Parameters
    ----------
    likelihood : float
        By how much the log-likelihood of the other recording is worse than with the true settings,
        as a share of it.
    errors_y, errors_w : tuple of float
        Relative errors of the standard deviations of which the fit says that it has found them.
    unknown : int
        How many it says not to have found.
    deviations : tuple of float
        All errors in standard deviations that the fit says.
    nis, nis_other : bool
        Whether the mean NIS is within its 95 % band; of the other recording in that which counts
        the error of what was found in the first, too.
    cover : float
        Share of true states of the other recording within 3 standard deviations.
    passes, seconds : float
    """

    likelihood: float
    errors_y: tuple[float, ...]
    errors_w: tuple[float, ...]
    unknown: int
    deviations: tuple[float, ...]
    nis: bool
    nis_other: bool
    cover: float
    passes: float
    seconds: float


def trial(machine: Machine, seed: int) -> Trial:
    """Tune from one of the four ways to be wrong."""
    y, w = WRONG_Y ** (1 - 2 * (seed % 2)), WRONG_W ** (1 - 2 * (seed // 2 % 2))
    recording, _ = machine.record(seed)
    start = machine.estimator(y=y, w=w)
    began = time.process_time()  # waiting for other processes does not count
    found = fit(start, machine.model, recording, free=["sigma_y", "sigma_w"])
    seconds = time.process_time() - began
    true = {f"sigma_y.{n}": s for n, s in machine.sigma_y.items()}
    true |= {f"sigma_w.{n}": s for n, s in machine.sigma_w.items()}
    known = [n for n in true if not any(d.startswith(f"{n} is") for d in found.doubts)]
    errors = {n: abs(found.values[n] / true[n] - 1) for n in known}
    off = [np.log(found.values[n] / s) / (found.std[n] / found.values[n]) for n, s in true.items()]
    other, x = machine.record(1000 + seed)
    best = bs.estimate(machine.estimator(), machine.model, other)
    own, tuned = (bs.estimate(found.estimator, machine.model, r) for r in (recording, other))
    reached, possible = (float(log_likelihood(r).sum()) for r in (tuned, best))
    inside = np.abs(tuned["x_hat"].values - x) <= 3 * tuned["x_std"].values
    return Trial(
        likelihood=(possible - reached) / abs(possible),
        errors_y=tuple(e for n, e in errors.items() if n.startswith("sigma_y")),
        errors_w=tuple(e for n, e in errors.items() if n.startswith("sigma_w")),
        unknown=len(true) - len(known),
        deviations=tuple(off),
        nis=_consistent(own),
        # The values are as uncertain as the mean of the NIS from which they come.
        nis_other=_consistent(tuned, wider=np.sqrt(2)),
        cover=float(inside.mean()),
        passes=found.passes,
        seconds=seconds,
    )


def _consistent(result: xr.Dataset, *, wider: float = 1.0) -> bool:
    low, high = nis_band(result)
    return abs(mean_nis(result) - (low + high) / 2) <= wider * (high - low) / 2


HEAD = (
    "machine", "samples", "worse likelihood, largest", "sigma_y within 5 %", "off at most",
    "sigma_w within 15 %", "off at most", "said not to be known", "rms error / ±",
    "NIS in band, own", "another", "3σ cover", "passes", "s",
)  # fmt: skip


def row(machine: Machine, trials: Sequence[Trial]) -> tuple[str, ...]:
    """One line of the table."""
    y, w = ([e for t in trials for e in getattr(t, k)] for k in ("errors_y", "errors_w"))
    off = np.array([t.deviations for t in trials])
    return (
        machine.name,
        f"{machine.samples}",
        f"{100 * max(t.likelihood for t in trials):.2f} %",
        f"{sum(e < 0.05 for e in y)} of {len(y)}",
        f"{100 * max(y, default=0):.1f} %",
        f"{sum(e < 0.15 for e in w)} of {len(w)}",
        f"{100 * max(w, default=0):.0f} %",
        f"{sum(t.unknown for t in trials)}",
        f"{np.sqrt((off**2).mean()):.2f}",
        f"{sum(t.nis for t in trials)} of {len(trials)}",
        f"{sum(t.nis_other for t in trials)}",
        f"{100 * np.mean([t.cover for t in trials]):.2f} %",
        f"{np.mean([t.passes for t in trials]):.0f}",
        f"{np.median([t.seconds for t in trials]):.2f}",
    )


def table(rows: Sequence[Sequence[str]]) -> str:
    """Markdown."""
    lines = [HEAD, ("---",) * len(HEAD), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.tuning", description=__doc__)
    parser.add_argument("--seeds", type=int, default=SEEDS)
    parser.add_argument("--only", default="", help="machines with these words in the name")
    given = parser.parse_args()
    rows = []
    for machine in MACHINES:
        if given.only in machine.name:
            rows.append(row(machine, [trial(machine, seed) for seed in range(given.seeds)]))
    print(table(rows))


if __name__ == "__main__":
    main()

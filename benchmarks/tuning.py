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

import backsight as bs
from backsight.analysis.consistency import log_likelihood, mean_nis, nis_band
from backsight.tune import fit
from benchmarks.tuning_problems import MACHINES, Machine

SEEDS = 10
WRONG_Y, WRONG_W = 10**0.5, 10.0
"""Factors of the standard deviations at the start."""


@dataclasses.dataclass(frozen=True)
class Trial:
    """One fit, judged on a recording that it has not seen.

    Parameters
    ----------
    likelihood : float
        By how much the log-likelihood is worse than with the true settings, as a share of it.
    errors_y, errors_w : tuple of float
        Relative errors of the standard deviations.
    deviations : tuple of float
        All errors in standard deviations that the fit says.
    doubted : bool
        Whether something was said not to be found.
    nis : bool
        Whether the mean NIS is within its 95 % band.
    cover : float
        Share of true states within 3 standard deviations.
    passes, seconds : float
    """

    likelihood: float
    errors_y: tuple[float, ...]
    errors_w: tuple[float, ...]
    deviations: tuple[float, ...]
    doubted: bool
    nis: bool
    cover: float
    passes: float
    seconds: float


def trial(machine: Machine, seed: int) -> Trial:
    """Tune from one of the four ways to be wrong."""
    y, w = WRONG_Y ** (1 - 2 * (seed % 2)), WRONG_W ** (1 - 2 * (seed // 2 % 2))
    recording, _ = machine.record(seed)
    began = time.perf_counter()
    found = fit(machine.estimator(y=y, w=w), machine.model, recording, free=["sigma_y", "sigma_w"])
    seconds = time.perf_counter() - began
    true = {f"sigma_y.{n}": s for n, s in machine.sigma_y.items()}
    true |= {f"sigma_w.{n}": s for n, s in machine.sigma_w.items()}
    errors = {n: found.values[n] / s - 1 for n, s in true.items()}
    off = [np.log(found.values[n] / s) / (found.std[n] / found.values[n]) for n, s in true.items()]
    other, x = machine.record(1000 + seed)
    best, tuned = (
        bs.estimate(e, machine.model, other) for e in (machine.estimator(), found.estimator)
    )
    reached, possible = (float(log_likelihood(r).sum()) for r in (tuned, best))
    low, high = nis_band(tuned)
    inside = np.abs(tuned["x_hat"].values - x) <= 3 * tuned["x_std"].values
    return Trial(
        likelihood=(possible - reached) / abs(possible),
        errors_y=tuple(e for n, e in errors.items() if n.startswith("sigma_y")),
        errors_w=tuple(e for n, e in errors.items() if n.startswith("sigma_w")),
        deviations=tuple(off),
        doubted=bool(found.doubts),
        nis=low <= mean_nis(tuned) <= high,
        cover=float(inside.mean()),
        passes=found.passes,
        seconds=seconds,
    )


HEAD = (
    "machine", "worse likelihood [%], largest", "sigma_y off [%], mean", "largest",
    "sigma_w off [%], mean", "largest", "rms error [its σ]", "NIS in band", "3σ cover [%]",
    "passes", "seconds",
)  # fmt: skip


def row(machine: Machine, trials: Sequence[Trial]) -> tuple[str, ...]:
    """One line of the table."""
    y, w = (np.abs([getattr(t, k) for t in trials]) for k in ("errors_y", "errors_w"))
    off = np.array([t.deviations for t in trials])
    return (
        machine.name,
        f"{100 * max(t.likelihood for t in trials):.2f}",
        f"{100 * y.mean():.1f}",
        f"{100 * y.max():.1f}",
        f"{100 * w.mean():.1f}",
        f"{100 * w.max():.1f}",
        f"{np.sqrt((off**2).mean()):.2f}",
        f"{sum(t.nis for t in trials)}/{len(trials)}",
        f"{100 * np.mean([t.cover for t in trials]):.2f}",
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
            print(rows[-1], flush=True)
    print(table(rows))


if __name__ == "__main__":
    main()

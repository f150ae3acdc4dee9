"""A study: how the length of a pendulum is found with the filter of this extension."""

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

import backsight as bs
from backsight_example.hinf import HInfinity
from backsight_example.pendulum import pendulum

LENGTH = 0.4


@dataclasses.dataclass(frozen=True)
class Findings:
    """What came out: a page, and a summary to print."""

    page: Path
    summary: str

    def __str__(self) -> str:
        return self.summary


@dataclasses.dataclass(frozen=True)
class Swing:
    """The study."""

    name: str = "swing"
    title: str = "The length of a pendulum from its swing"
    seeds: int = 3

    def run(
        self,
        out: Path,
        *,
        seeds: Sequence[int],
        recordings: Sequence[Path] = (),
        progress: Callable[[str, float], None] = lambda *_: None,
        force: bool = False,
    ) -> Findings:
        """Simulate, estimate, and write what was found into a folder."""
        del recordings
        found = []
        for i, seed in enumerate(seeds):
            progress("pendulums", i / len(seeds))
            found.append(_length(seed))
        summary = f"length: {np.mean(found):.3f} m, the truth is {LENGTH} m"
        # The folder is there whole or not at all, and replaces nothing of others.
        with bs.extend.whole(out, force=force) as folder:
            page = f"<!doctype html><title>{self.title}</title><p>{summary}</p>\n"
            (folder / "index.html").write_text(page)
        return Findings(out / "index.html", summary)


STUDY = Swing()


def _length(seed: int) -> float:
    plant, M = pendulum(LENGTH), 3 * np.sin(np.arange(400) * 0.05)
    simulated = bs.simulate(plant, u=M, dt=0.02, x0={"angle": 0.5}, sigma_y=2e-3, seed=seed)
    joint = bs.augment(pendulum(0.5), ["length"])
    noise = bs.Noise(sigma_y=2e-3, sigma_w={"rate": 1e-3})
    prior = bs.Prior(sigma_x0={"angle": 0.5, "rate": 1.0, "length": 0.1}, x0={"angle": 0.4})
    result = bs.estimate(HInfinity(noise, prior), joint, simulated)
    return float(result["x_hat"].sel(state="length")[-1])

"""Weight and horizon of a window without truth: ``python -m benchmarks.tuning_windows``.

A positioning stage whose payload is taken off in the middle, behind a band-pass filter; in half of
the recordings a second mode moves along of which the observer does not know. The weight alpha and
the horizon N of a moving horizon observer are chosen from the recording alone, and beside that from
all combinations with the truth: the root mean square error of the stiffness per mass.
"""

import argparse
import dataclasses
import functools
import time
from collections.abc import Callable, Sequence

import numpy as np
import xarray as xr

import backsight as bs
from backsight.engine.lanes import run_many
from backsight.engine.recursion import Recursion
from backsight.run.estimation import match
from backsight.tune.fitting.runners import opened_to_inputs
from backsight.tune.fitting.values import unknowns_of
from backsight.types import Array

DT, SAMPLES, BEFORE = 1e-4, 4000, 2000
ALPHAS = tuple(10.0**k for k in range(-6, 2))
HORIZONS = (3, 5, 10, 15, 25)
WITH = {"k": 7.06e6, "b": 77.6, "c": 5.4e5}
WITHOUT = {"k": 9.21e6, "b": 86.8, "c": 7.04e5}
PAYLOAD_OFF = (BEFORE + SAMPLES // 2) * DT

NOISE = bs.Noise(
    sigma_y=1e-3, sigma_w={"q": 1e-2, "v": 1e2, "k": 1e4, "b": 5e-2, "c": 1e3, "w": 1e4}
)
PRIOR = bs.Prior(sigma_x0={"q": 1.0, "v": 1e3, "k": 1e6, "b": 1.0, "c": 1e5, "w": 1.0})


def _binary(seed: int, n: int) -> Array:
    return bs.signals.prbs(n, seed=seed, samples_per_bit=7, amplitude=1.2)


def _levels(seed: int, n: int) -> Array:
    levels = np.random.default_rng(seed).uniform(-1.8, 1.8, n // 6 + 1)
    return np.repeat(levels, 6)[:n, None]


def _noise(seed: int, n: int) -> Array:
    return np.random.default_rng(seed).standard_normal((n, 1))


DRIVES: dict[str, Callable[[int, int], Array]] = {
    "binary": _binary, "levels": _levels, "noise": _noise,
}  # fmt: skip


def stage(second: float) -> bs.Model:
    """The stage, with the gain of a second mode at 1100 Hz."""
    omega = 2 * np.pi * 1100.0
    return bs.Model(
        f=lambda x, u, p: [
            x.v,
            -p.k * x.q - p.b * x.v + p.c * u.V,
            x.v2,
            -(omega**2) * x.q2 - 0.04 * omega * x.v2 + second * p.c * u.V,
        ],
        h=lambda x, _u, _p: [x.q + x.q2],
        states={"q": "um", "v": "um/s", "q2": "um", "v2": "um/s"},
        inputs={"V": "V"},
        outputs={"y": "um"},
        parameters=WITH,
    )


def joint() -> bs.Model:
    """What the observer knows: one mode, its parameters and a force unknown."""
    one = bs.Model(
        f=lambda x, u, p: [x.v, -p.k * x.q - p.b * x.v + p.c * u.V],
        h=lambda x, _u, _p: [x.q],
        states={"q": bs.Signal("um", scale=5.0), "v": bs.Signal("um/s", scale=1e4)},
        inputs={"V": bs.Signal("V", scale=5.0)},
        outputs={"y": bs.Signal("um", scale=5.0)},
        parameters={
            "k": bs.Signal("1/s2", value=6e6, scale=7e6, lower=0.0),
            "b": bs.Signal("1/s", value=70.0, scale=70.0, lower=0.0),
            "c": bs.Signal("um/s2/V", value=5e5, scale=8e5, lower=0.0),
        },
    )
    return bs.augment(one, ["k", "b", "c"], disturbances={"w": "v"})


def record(seed: int, drive: str, second: float) -> tuple[xr.Dataset, Array]:
    """A recording, and its true stiffness per mass."""
    n = BEFORE + SAMPLES

    def pull(time: Array) -> Array:
        since = time - PAYLOAD_OFF
        pulse = np.where(since < 3e-3, 2e5 * np.sin(np.pi * since / 3e-3), 0.0)
        return np.where(since > -1e-9, 2e4 + pulse, 0.0)

    raw = bs.simulate(
        stage(second), DRIVES[drive](seed, n), dt=DT, changes={PAYLOAD_OFF: WITHOUT},
        disturbances={"v": pull}, sigma_y=1e-3, seed=1000 + seed,
    )  # fmt: skip
    b, a = bs.signals.bandpass(DT, damping=0.1)
    both = bs.signals.filtered(np.hstack([raw["u"].values, raw["y"].values]), b=b, a=a)[BEFORE:]
    k = raw["x_true"].sel(state="k").values[BEFORE:]
    return bs.from_arrays(
        dt=DT, u=both[:, :1], y=both[:, 1:], inputs={"V": "V"}, outputs={"y": "um"}
    ), k


def observer(alpha: float, N: int) -> bs.MHO:
    """A moving horizon observer, its bands left out."""
    heun = bs.Integrator("heun", substeps=8)
    return bs.MHO(NOISE, PRIOR, N=N, alpha=alpha, integrator=heun, bands="filters")


def errors(model: bs.Model, recording: xr.Dataset, k: Array) -> dict[tuple[float, int], float]:
    """Root mean square error of the stiffness of all combinations."""
    found, at = {}, model.index("k")
    u, *seen = match(model, recording, estimator=observer(1.0, 10))
    for N in HORIZONS:
        recursion = _program(N)
        rows = [[np.hstack([u, np.full((len(u), 1), alpha)]), *seen] for alpha in ALPHAS]
        outcome = run_many(recursion, rows, carries=[recursion.carry0] * len(rows), threads=1)
        place = [c.name for c in recursion.channels].index("x_hat")
        for alpha, (_, outputs) in zip(ALPHAS, outcome, strict=True):
            x = outputs[place]
            found[alpha, N] = float(np.sqrt(np.mean((x[1:, at] - k[1:]) ** 2)))
    return found


@functools.cache
def _program(N: int) -> Recursion:
    """The observer with its weight as an input, so that one program serves all."""
    given, model = observer(1.0, N), joint()
    wide = opened_to_inputs(given, model, DT, unknowns_of([bs.tune.Free("alpha")], given, model))
    return wide.varied.compile(wide.model, DT)


@dataclasses.dataclass(frozen=True)
class Trial:
    """A choice without truth, beside all combinations with it."""

    drive: str
    seed: int
    second: float
    chosen: tuple[float, int]
    best: tuple[float, int]
    errors: dict[tuple[float, int], float]
    seconds: float

    @property
    def ratio(self) -> float:
        """Error of the choice by the smallest."""
        return self.errors[self.chosen] / self.errors[self.best]

    @property
    def middle(self) -> float:
        """Median of all errors by the smallest."""
        return float(np.median(list(self.errors.values()))) / self.errors[self.best]


def trial(seed: int, drive: str, second: float) -> Trial:
    """Choose on a recording, and judge the choice."""
    model = joint()
    recording, k = record(seed, drive, second)
    choices = [bs.tune.Choice("alpha", ALPHAS), bs.tune.Choice("N", HORIZONS)]
    began = time.perf_counter()
    found = bs.tune.fit(observer(1.0, 10), model, recording, free=choices)
    seconds = time.perf_counter() - began
    of = errors(model, recording, k)
    best = min(of, key=lambda c: of[c])
    chosen: tuple[float, int] = (found.chosen["alpha"], found.chosen["N"])  # type: ignore[assignment]
    return Trial(drive, seed, second, chosen, best, of, seconds)


def together(trials: Sequence[Trial]) -> str:
    """Error over all recordings: of the choices, and of the one option that is best for all."""
    squares = np.array([list(t.errors.values()) for t in trials]) ** 2
    least = squares.min(axis=1).mean()
    chosen = float(np.mean([t.errors[t.chosen] ** 2 for t in trials]))
    options = list(trials[0].errors)
    one = int(squares.mean(axis=0).argmin())
    alpha, N = options[one]
    return (
        f"All recordings: the choices have {np.sqrt(chosen / least):.3f} times the error of the "
        f"best of each; {alpha:g}, {N} for all, which the truth finds best, "
        f"{np.sqrt(squares[:, one].mean() / least):.3f} times."
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.tuning_windows", description=__doc__
    )
    parser.add_argument("--seeds", type=int, default=3)
    given = parser.parse_args(arguments)
    print("| excitation | seed | second mode | chosen | best | error / best | median / best | s |")
    print("|---|---|---|---|---|---|---|---|")
    trials = []
    for drive in DRIVES:
        for second in (0.0, 0.3):
            for seed in range(201, 201 + given.seeds):
                trials.append(t := trial(seed, drive, second))
                print(
                    f"| {t.drive} | {t.seed} | {t.second:g} | {t.chosen[0]:g}, {t.chosen[1]} | "
                    f"{t.best[0]:g}, {t.best[1]} | {t.ratio:.3f} | {t.middle:.2f} | "
                    f"{t.seconds:.1f} |",
                    flush=True,
                )
    print("\n" + together(trials))


if __name__ == "__main__":
    main()

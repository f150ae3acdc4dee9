"""Run estimators over very many samples: ``python -m benchmarks.long --samples 1e8``.

Every estimator on every plant that it can take, block by block with the memory handed on. Told are
the smallest eigenvalue of any covariance that is looked at, with a diagonal of ones (at every
sample the variances, at every `LOOKED` the eigenvalues); samples whose status says that something
failed; the squares of the errors by their covariances in the first and in the last tenth, whose
mean should be one; how far the estimates are from those of extended precision, in standard
deviations, in the first and in the second half of the samples that are compared; and by how much
the memory of the process grew after the first block.
"""

import argparse
import dataclasses
import resource
import time
from collections.abc import Iterator, Sequence

import numpy as np

import backsight as bs
from backsight.engine import native
from backsight.errors import BacksightError
from backsight.estimators import AbstractEstimator
from backsight.models.lti import is_linear
from backsight.schema import Status
from backsight.types import Array
from benchmarks.long.exact import filtered
from benchmarks.long.plants import Plant, plants

BLOCK = 20_000
LOOKED = 97
HORIZON = 8

FAILED = Status.NOT_FINITE | Status.NOT_POSITIVE_DEFINITE | Status.INFEASIBLE

LIKE_THE_FILTER = ("KF", "EKF", "UKF", "LinearMHE", "MHE")
"""Estimates of linear models are those of the Kalman filter."""


def main() -> None:
    """Print a line for each plant and estimator."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.long", description=__doc__)
    parser.add_argument("--samples", type=float, default=1e8)
    parser.add_argument("--exact", type=float, default=2e4, help="compared with extended precision")
    parser.add_argument("--plants", nargs="+", metavar="WORD", help="with this in the name")
    parser.add_argument("--estimators", nargs="+", metavar="NAME")
    given = parser.parse_args()
    print(HEAD, RULE, sep="\n")
    for plant in plants():
        if given.plants and not any(word in plant.name for word in given.plants):
            continue
        for name, estimator in estimators(plant).items():
            if not given.estimators or name in given.estimators:
                try:
                    done = run(plant, name, estimator, int(given.samples), int(given.exact))
                except BacksightError as refused:
                    print(f"| {plant.name:<24} | {name:<9} | refused: {refused}", flush=True)
                else:
                    print(done.row(), flush=True)


def estimators(plant: Plant) -> dict[str, AbstractEstimator]:
    """Those that the plant can have."""
    noise, prior, window = plant.noise, plant.prior, {"N": HORIZON}
    found: dict[str, AbstractEstimator] = {}
    if is_linear(plant.model) or plant.turns:
        found["KF"] = bs.KalmanFilter(noise, prior)
        found["LinearMHE"] = bs.LinearMHE(noise, prior, **window, arrival_weight=1.0)
    found["EKF"] = bs.EKF(noise, prior)
    found["UKF"] = bs.UKF(noise, prior)
    found["MHO"] = bs.MHO(noise, prior, **window, alpha=0.1)
    found["MHE"] = bs.MHE(noise, prior, **window)
    if any(s.name == "F" for s in plant.model.parameters):
        found["CS-MHE"] = bs.CompressiveSensingMHE(noise, prior, **window, forces=("F",), lam=50.0)
    return found


@dataclasses.dataclass
class Done:
    """What a run has shown so far."""

    plant: str
    estimator: str
    samples: int = 0
    smallest: float = np.inf
    failed: int = 0
    first: float = np.nan
    last: float = np.nan
    apart: tuple[float, float] = (np.nan, np.nan)
    seconds: float = 0.0
    grown: float = 0.0

    def row(self) -> str:
        """A line of the table."""
        apart = "" if np.isnan(self.apart[0]) else f"{self.apart[0]:.0e}, {self.apart[1]:.0e}"
        return (
            f"| {self.plant:<24} | {self.estimator:<9} | {self.samples:>9.0e} | "
            f"{self.smallest:>9.1e} | {self.failed:>6} | {self.first:>5.2f} | {self.last:>5.2f} | "
            f"{apart:>12} | {1e6 * self.seconds / self.samples:>9.2f} | {self.grown:>6.1f} |"
        )


HEAD = (
    f"| {'plant':<24} | {'estimator':<9} | {'samples':>9} | {'least eig':>9} | failed | first |"
    f"  last | {'from exact':>12} | us/sample | + MiB  |"
)
RULE = "|" + "|".join("-" * len(cell) for cell in HEAD.split("|")[1:-1]) + "|"


def run(plant: Plant, name: str, estimator: AbstractEstimator, samples: int, exact: int) -> Done:
    """All samples through one estimator."""
    recursion = estimator.compile(plant.model, plant.dt)
    outputs = [c.name for c in recursion.channels]
    at = [outputs.index(k) for k in ("x_hat", "P", "status")]
    packing = recursion.channels[at[1]]
    told, carry = Done(plant.name, name), recursion.carry0
    tenth, before = max(samples // 10, 1), 0.0
    waiting = np.zeros((0, plant.model.nx))
    sums = {"first": [0.0, 0], "last": [0.0, 0]}
    begin: list[list[Array]] = []
    for k, (x, u, y, mask) in enumerate(recorded(plant, samples)):
        began = time.process_time()
        carry, results = native.run(recursion, [u, y, mask], carry=carry)
        told.seconds += time.process_time() - began
        x_hat, P, status = (results[i] for i in at)
        first, told.samples = told.samples, told.samples + len(x)
        variances = P[:, np.diag(packing.entries(P.shape[1]))]
        looked = packing.unpack(P[::LOOKED])
        told.smallest = min(told.smallest, least(looked), float((variances > 0).all()) - 1e-300)
        told.failed += int((status.astype(int) & int(FAILED) != 0).sum())
        if k * BLOCK < exact:
            begin.append([u, y, mask, x_hat, variances])
        # The newest samples wait for estimates that look back.
        truth = np.vstack([waiting, x])[: len(x_hat)] if recursion.lag else x
        waiting = x[len(x) - recursion.lag :] if recursion.lag else waiting
        if not recursion.lag or first:
            squares = normalised((x_hat - truth[: len(x_hat)])[::LOOKED], looked)
            early, late = first < max(tenth, 2 * BLOCK), told.samples > samples - tenth
            for part, inside in (("first", early), ("last", late)):
                if inside:
                    sums[part][0] += squares.sum()
                    sums[part][1] += len(squares)
        if k == 0:
            before = memory()
    told.first, told.last = (
        total / max(count, 1) / plant.model.nx for total, count in sums.values()
    )
    told.grown = memory() - before
    if name in LIKE_THE_FILTER and is_linear(plant.model):
        told.apart = compared(plant, begin, exact)
    return told


def recorded(plant: Plant, samples: int) -> Iterator[list[Array]]:
    """Truth, inputs, outputs and mask, block by block; the same for every estimator."""
    truth, rng = plant.truth(), np.random.default_rng(0)
    state = truth.carry0
    for first in range(0, samples, BLOCK):
        n = min(BLOCK, samples - first)
        state, (x, u, y) = native.run(truth, plant.drawn(first, n, rng), carry=state)
        mask = plant.measured(first, n)
        yield [x, u, np.where(mask > 0, y, 0.0), mask]


def least(P: Array) -> float:
    """Smallest eigenvalue of covariances (n, nx, nx) with diagonals of ones."""
    sigma = np.sqrt(np.einsum("kii->ki", P))
    return float(np.linalg.eigvalsh(P / (sigma[:, :, None] * sigma[:, None, :])).min())


def normalised(errors: Array, P: Array) -> Array:
    """Squares of errors (n, nx) by their covariances (n, nx, nx)."""
    sigma = np.sqrt(np.einsum("kii->ki", P))
    of_ones = P / (sigma[:, :, None] * sigma[:, None, :])
    by = errors / sigma
    return np.einsum("ki,kij,kj->k", by, np.linalg.pinv(of_ones, hermitian=True), by)


def compared(plant: Plant, begin: Sequence[Sequence[Array]], exact: int) -> tuple[float, float]:
    """Largest distance from extended precision in both halves [standard deviations]."""
    u, y, mask, x_hat, variances = (np.vstack(k)[:exact] for k in zip(*begin, strict=True))
    found = np.abs(x_hat - filtered(plant, u, y, mask)) / np.sqrt(variances)
    half = len(found) // 2
    return float(found[:half].max()), float(found[half:].max())


def memory() -> float:
    """Largest memory of this process so far [MiB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


if __name__ == "__main__":
    main()

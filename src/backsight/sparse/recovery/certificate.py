"""Map of the sparse forces that l1 minimisation is certain to find."""

import dataclasses
import itertools
import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np
import xarray as xr

from backsight.description import Count, Positive, checked
from backsight.errors import TuningError
from backsight.estimators.force_estimator import AbstractForceEstimator, Forced
from backsight.models.model import Model
from backsight.sparse.recovery._null_space import NEGLIGIBLE, Ratios, Seen, ratios, worst_error
from backsight.types import Array

CLEAR = 1e-6
"""Ratios this close to one, the accuracy of a linear program, are not called recovered."""


@checked()
def check_recovery(
    estimator: AbstractForceEstimator,
    model: Model,
    *,
    dt: Positive,
    most: Count = 2,
    sigmas: Positive = 3.0,
    ages: Sequence[int] | None = None,
    progress: Callable[[int], None] = lambda _: None,
) -> xr.Dataset:
    r"""Certify which forces in a window are found by the smallest l1 norm, whatever their sizes.

    Of all first states and forces that explain the readings of a window exactly those with the
    smallest :math:`\lVert\alpha\rVert_1` are taken. Whether these are the true ones is decided by
    where forces act and by their signs, not by their sizes: this function says for every atom of
    the dictionary at every moment of the window whether every force there is found, and with how
    many others beside it, of which every combination is. The condition is necessary and sufficient:
    where it fails there are sizes with which something else is found.

    A certificate is about readings without noise, an exact model, and a first state of which
    nothing is known. An estimator with `lam` and an arrival cost finds what is certified as noise
    and `lam` become small. What noise does is `error`; how often hits are found under noise, or
    those that are not certified, is counted by `backsight.tune.rate_sensors`.

    Parameters
    ----------
    estimator : CompressiveSensingMHE
        Its window, dictionary, known signs and noise of the sensors count.
    model : Model
        Linear.
    dt : float
        Sampling period [s].
    most : int
        Up to so many forces that begin at the same sample, at different places.
    sigmas : float
        For `error`: no reading is off by more than so many standard deviations of its noise.
    ages : sequence of int, optional
        Moments to look at: samples that were measured after the force began. All of the window if
        not given; 0 is there only if the outputs contain the forces of their own sample.
    progress : callable
        Told the number of moments done.

    Returns
    -------
    xarray.Dataset
        ``ratio (age, atom)``: below one exactly if every force of this atom alone is found; the
        smaller the clearer. ``together (age, atom)``: the largest number, up to `most`, of which
        every set with this atom is found. ``pair_ratio (atom, other)``: of two forces at once, at
        the moment where it is largest; NaN where both are of one place, or `most` is 1.
        ``error (age, atom)``: the size of a force alone, found under noise by the smallest l1 norm
        that keeps to the noise, is off by no more than this, and all others together are no larger
        [unit of the force]; infinite where it is not found. Forces twice as large are the largest
        that is seen.

        Attributes: ``number``, the largest that is certified for all atoms at all moments;
        ``coherence``, the largest cosine between what two atoms show, and
        ``number_by_coherence``, what follows from it alone, (1 + 1/coherence)/2: sufficient, and
        far too careful for neighbouring places; ``isometry``, the constant of restricted isometry
        of second order, which for columns of length one is the coherence: below 0.707 one force
        is found. ``verdict`` in words.

    Raises
    ------
    TuningError
        If the first state cannot be seen in the window, or a moment is not in it.

    References
    ----------
    Poe, Mallada, Vidal, "Necessary and sufficient conditions for simultaneous state and input
    recovery of linear systems with sparse inputs by l1-minimization", 2023, arXiv:2304.05526.
    Donoho, Elad, "Optimally sparse representation in general (nonorthogonal) dictionaries via l1
    minimization", 2003, doi:10.1073/pnas.0437847100.
    Cai, Zhang, "Sparse representation of a signal with convex relaxation", 2014, IEEE Transactions
    on Information Theory 60, doi:10.1109/TIT.2013.2288639.

    Examples
    --------
    >>> sensors, forces = {"tip": ("displacement", [1.0])}, {"hit": [1.0]}
    >>> rod = bs.modal([9.0], damping=[0.03], sensors=sensors, forces=forces)
    >>> noise, prior = bs.Noise(sigma_y=1e-5), bs.Prior(sigma_x0=1e-5)
    >>> finder = bs.CompressiveSensingMHE(noise, prior, forces=("hit",), lam=15.0, N=6)
    >>> found = bs.check.check_recovery(finder, rod, dt=0.01)
    >>> found["ratio"].sel(age=3).values < 1
    array([ True])
    """
    forced = estimator.forced(model, dt)
    shapes = estimator.dictionary.shapes(len(forced.names))
    N = estimator.horizon
    known = list(range(N, -1 if forced.direct else 0, -1))
    wanted = known if ages is None else [int(age) for age in ages]
    if not wanted or set(wanted) - set(known):
        raise TuningError(f"ages are {wanted}; give whole numbers from {known[-1]} to {known[0]}")
    seen = _seen(forced, shapes, estimator.sides(), N)
    if not seen.state_is_seen():
        raise TuningError(
            f"a window of N = {N} samples does not show all states, so that no force in it is "
            "certain; take a longer window or more sensors"
        )
    phi = seen.without_state()
    programs = ratios(phi, seen.sides)
    belongs = estimator.dictionary.force_of(len(forced.names))
    names = _atoms(forced.names, belongs)
    n = len(names)
    error, pairs = np.full((len(wanted), n), math.inf), np.full((n, n), np.nan)
    moments = []
    for row, age in enumerate(wanted):
        first = (N - age) * n
        moments.append(_sets(programs, first, belongs, most))
        for chosen, worst in moments[-1].worst.items():
            if len(chosen) == 2:
                pairs[chosen] = pairs[chosen[::-1]] = np.fmax(pairs[chosen], worst)
        for a in np.flatnonzero(moments[-1].together):
            error[row, a] = worst_error(seen, int(first + a), sigmas)
        progress(row + 1)
    result = xr.Dataset(
        {
            "ratio": (("age", "atom"), [[m.worst[(a,)] for a in range(n)] for m in moments]),
            "together": (("age", "atom"), [m.together for m in moments]),
            "pair_ratio": (("atom", "other"), pairs),
            "error": (("age", "atom"), error),
        },
        coords={"age": wanted, "atom": names, "other": names},
    )
    coherence = _coherence(phi)
    result.attrs = {
        "number": int(result["together"].min()),
        "coherence": coherence,
        "number_by_coherence": math.ceil((1 + 1 / coherence) / 2) - 1 if coherence else n,
        "isometry": coherence,
        "verdict": _verdict(result, most),
    }
    return result


def _seen(forced: Forced, shapes: Array, sides: Array, N: int) -> Seen:
    """Readings of a window by its first state and by atoms at its steps, oldest first."""
    A, C = forced.system.A, forced.system.C
    (ny, nx), (nf, widths, atoms) = C.shape, shapes.shape
    steps = N + forced.direct
    root = np.linalg.cholesky(forced.system.s.R)
    x = np.hstack([np.eye(nx), np.zeros((nx, steps * atoms))])
    rows = []
    for k in range(N + 1):
        acting = np.zeros((nf, steps * atoms))
        for s in range(min(widths, k + 1)):
            if (i := k - s) < steps:
                acting[:, i * atoms : (i + 1) * atoms] = shapes[:, s]
        y, x = C @ x, A @ x
        y[:, nx:] += forced.F @ acting
        x[:, nx:] += forced.E @ acting
        rows.append(np.linalg.solve(root, y))
    readings = np.array(rows).reshape((N + 1) * ny, -1)
    return Seen(readings[:, :nx], readings[:, nx:], np.tile(sides, steps))


def _atoms(forces: Sequence[str], belongs: Sequence[int]) -> list[str]:
    """Names of the atoms: of their force, counted where it has several."""
    found = []
    for a, force in enumerate(belongs):
        alone = belongs.count(force) == 1 and force >= 0
        found.append(
            forces[force]
            if alone
            else f"{forces[force] if force >= 0 else 'atom'} {belongs[: a + 1].count(force)}"
        )
    return found


@dataclasses.dataclass(frozen=True)
class _Moment:
    """What is certified at one moment.

    Parameters
    ----------
    worst : dict
        Largest ratio of the sets of atoms that were tried.
    together : tuple of int
        Of every atom, up to how many with it.
    """

    worst: Mapping[tuple[int, ...], float]
    together: tuple[int, ...]


def _sets(programs: Ratios, first: int, belongs: Sequence[int], most: int) -> _Moment:
    """Try sets of atoms of different forces; a set fails where a part of it does."""
    n = len(belongs)
    worst: dict[tuple[int, ...], float] = {}
    together = np.zeros(n, int)
    alive = set(range(n))
    for size in range(1, most + 1):
        fails: set[int] = set()
        tried = 0
        for chosen in itertools.combinations(range(n), size):
            forces = [belongs[a] for a in chosen if belongs[a] >= 0]
            # Beyond pairs, which are shown, only what an atom still depends on.
            if len(set(forces)) < len(forces) or (size > 2 and not alive & set(chosen)):
                continue
            tried += 1
            parts = (worst.get(p, 0.0) for p in itertools.combinations(chosen, size - 1))
            if size > 2 and any(p >= 1 - CLEAR for p in parts):
                fails |= set(chosen)
                continue
            worst[chosen] = programs.worst(tuple(first + a for a in chosen))
            if worst[chosen] >= 1 - CLEAR:
                fails |= set(chosen)
        alive -= fails
        if not tried or not alive:
            break
        together[list(alive)] = size
    return _Moment(worst, tuple(together.tolist()))


def _coherence(phi: Array) -> float:
    """Largest cosine between two columns; 1 if one of them is zero."""
    size = np.linalg.norm(phi, axis=0)
    if not (size > NEGLIGIBLE * size.max()).all():
        return 1.0
    cosines = np.abs((phi / size).T @ (phi / size))
    np.fill_diagonal(cosines, 0.0)
    return float(min(cosines.max(), 1.0))


def _verdict(found: xr.Dataset, most: int) -> str:
    number = int(found["together"].min())
    alone = found["ratio"] < 1 - CLEAR
    said = []
    if number:
        many = "every force alone" if number == 1 else f"every set of {number} forces at once"
        said.append(f"{many} is found, at all moments")
    else:
        missed = ", ".join(str(a) for a in found["atom"].values if not alone.sel(atom=a).all())
        said.append(
            f"a force alone is found at {int(alone.sum())} of {alone.size} moments and places, "
            f"not always: {missed}"
        )
    pairs = found["pair_ratio"].values[np.triu_indices(found.sizes["atom"], 1)]
    pairs = pairs[~np.isnan(pairs)]
    if number < 2 <= most and len(pairs):
        sure = int((pairs < 1 - CLEAR).sum())
        said.append(f"of {len(pairs)} pairs of places {sure} are found at all moments")
    return "; ".join(said)

"""What a window of sparse forces does after the l1 norm, against the same done by other routes."""

import itertools

import numpy as np
import pytest

import backsight as bs
from backsight.errors import TuningError
from backsight.run.sparse_forces import prepared
from backsight.sparse import l1_path
from closeness import assert_close
from estimators import struck

SAMPLES = 10
FIRST, SECOND = struck.FORCES[:2]


def window(**settings):
    """One window over a whole recording, and the regression that it is."""
    of = struck.system(accelerations=True)
    u, y = struck.record(of, SAMPLES, seed=7, missing=0.1)
    outputs = {"y": "m", "z": "m"}
    recording = bs.from_arrays(u=u, y=y, dt=struck.DT, inputs={"f": "N"}, outputs=outputs)
    made = bs.CompressiveSensingMHE(
        **struck.gaussians(of), forces=struck.FORCES, lam=0.4, N=SAMPLES - 1,
        sigma_force=struck.SIGMA_FORCE, **settings
    )  # fmt: skip
    found = bs.estimate(made, struck.model(of), recording, engine="vm")
    search = prepared(made, struck.model(of), recording)
    return made, found, search


def rows(found, search, values, which):
    """Forces of the first row as the window and as the regression have them."""
    d = search.forces(np.asarray(which), np.asarray(values))
    return found["d_raw"].values[0], d[0]


def fitted(regression, support):
    H = regression.columns[:, support]
    a = np.linalg.lstsq(H, regression.target, rcond=None)[0]
    return a, float(((regression.target - H @ a) ** 2).sum())


@pytest.mark.parametrize("known", [{}, {"nonnegative": (struck.FORCES[2],)}])
@pytest.mark.parametrize("penalty", [8.0, 60.0])
def test_exchanges_find_the_best_set(penalty, known):
    """By trying all sets of up to two atoms whose signs are allowed."""
    how = bs.forces.Exchanges(penalty=penalty, most=2)
    _, found, search = window(refinement=how, **known)
    regression, columns = search.regression, range(search.regression.columns.shape[1])
    best = np.inf, (), np.zeros(0)
    for size in range(3):
        for support in map(list, itertools.combinations(columns, size)):
            values, cost = fitted(regression, support)
            if (regression.side[support] * values >= 0).all():
                best = min(best, (cost + penalty * size, support, values), key=lambda b: b[0])
    _, support, values = best
    assert found["nonzeros"].values[0] == len(support) > 0
    assert_close(*rows(found, search, values, support), 1e-7)
    assert not found["status"].values[0]


def test_exchanges_find_what_the_search_over_the_whole_recording_finds():
    _, found, search = window(refinement=bs.forces.Exchanges(penalty=1.0))
    chosen = bs.forces.Greedy(penalty=1.0).select(search)
    assert found["nonzeros"].values[0] == len(chosen.which) > 2
    assert_close(*rows(found, search, chosen.values, chosen.which), 1e-7)


def test_weights_that_shrink_are_those_of_the_whole_recording():
    _, found, search = window(refinement=bs.forces.Reweighting(passes=2, floor=0.2), bias="kept")
    chosen = bs.forces.Reweighted(iterations=2, floor=0.2, refit=False).select(search)
    assert found["nonzeros"].values[0] == len(chosen.which) > 0
    assert_close(*rows(found, search, chosen.values, chosen.which), 1e-7)
    assert not found["status"].values.any()


@pytest.mark.parametrize("span", ["step", "window"])
def test_groups_share_their_weights(span):
    """By the path of an l1 problem with the weights of every pass."""
    groups = (struck.FORCES,) if span == "step" else ()
    how = bs.forces.Reweighting(passes=3, floor=0.1, groups=groups, span=span)
    made, found, search = window(refinement=how, bias="kept")
    label = search.step if span == "step" else search.atom
    which, values = l1_path(search.regression, made.lam).at(made.lam)
    floor = None
    for _ in range(how.passes):
        a = np.zeros(len(label))
        a[which] = values
        sizes = np.sqrt(np.bincount(label, a**2))[label]
        floor = 0.1 * sizes.max() if floor is None else floor
        weights = floor / (floor + sizes)
        which, values = l1_path(search.regression, made.lam, weights=weights).at(made.lam)
    assert found["nonzeros"].values[0] == len(which) > 0
    assert_close(*rows(found, search, values, which), 1e-7)


def test_hits_are_found_that_the_l1_norm_blurs():
    """Two neighbours of one model: without bias, and only where they were."""
    of = struck.system()
    d = np.zeros((30, len(struck.FORCES)))
    d[8, 0], d[19, 1] = 8.0, -6.0
    model = bs.forces.forces_as_inputs(struck.model(of), list(struck.FORCES))
    data = bs.simulate(model, np.hstack([np.zeros((30, 1)), d]), dt=struck.DT, sigma_y=1e-4, seed=2)
    made = bs.CompressiveSensingMHE(
        bs.Noise(sigma_y=1e-4), bs.Prior(P0=struck.P0), forces=struck.FORCES, lam=1.0, N=6,
        threshold=0.5, refinement=bs.forces.Exchanges(),
    )  # fmt: skip
    found = bs.estimate(made, struck.model(of), data, engine="vm")
    error = np.abs(found["d_hat"].values - d)
    assert ((found["d_hat"].values != 0) == (d != 0)).all()
    assert (error <= 4 * found["d_std"].values).all()


def test_what_a_window_cannot_do_is_refused():
    with pytest.raises(TuningError, match="refinement: a window with limits"):
        window(refinement=bs.forces.Exchanges(), largest=3.0)
    with pytest.raises(TuningError, match="'G' is none of the forces"):
        window(refinement=bs.forces.Reweighting(groups=(("G",),)))
    with pytest.raises(TuningError, match="is named twice"):
        window(refinement=bs.forces.Reweighting(groups=((FIRST, SECOND), (SECOND,))))


def test_a_window_has_no_more_atoms_than_it_may():
    _, found, _ = window(refinement=bs.forces.Exchanges(penalty=0.1, most=1))
    assert found["nonzeros"].values.max() == 1

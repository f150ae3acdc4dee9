"""Groups of sparse forces: against all sets of two, and by finding forces that were made."""

import itertools

import numpy as np
import pytest

import backsight as bs
from backsight.errors import TuningError
from backsight.run.sparse_forces import prepared
from estimators import struck
from oracles import struck_beam

AXES = (struck.FORCES[:2], struck.FORCES[2:])
SAMPLES = 30


def searched(span, **settings):
    """Columns of a short recording, and the selection of groups of it."""
    of = struck.system(accelerations=True)
    u, y = struck.record(of, 8, seed=7, missing=0.1)
    outputs = {"y": "m", "z": "m"}
    data = bs.from_arrays(u=u, y=y, dt=struck.DT, inputs={"f": "N"}, outputs=outputs)
    made = bs.CompressiveSensingMHE(
        **struck.gaussians(of), forces=struck.FORCES, lam=1.0, sigma_force=struck.SIGMA_FORCE,
        **settings
    )  # fmt: skip
    groups = AXES if span == "step" else ()
    how = bs.forces.GreedyGroups(groups=groups, span=span, penalty=4.0)
    return prepared(made, struck.model(of), data), how


@pytest.mark.parametrize("span", ["step", "recording"])
def test_the_best_groups_are_found(span):
    search, how = searched(span)
    H, y = search.regression.columns, search.regression.target
    label = search.step * 2 + search.atom // 2 if span == "step" else search.atom
    members = [np.flatnonzero(label == g) for g in np.unique(label)]
    sums = {}
    for size in range(3):
        for groups in itertools.combinations(range(len(members)), size):
            which = np.concatenate([np.zeros(0, int), *(members[g] for g in groups)])
            a, _, rank, _ = np.linalg.lstsq(H[:, which], y, rcond=1e-6)
            sums[groups] = ((y - H[:, which] @ a) ** 2).sum() + 4.0 * rank
    best = min(sums, key=lambda groups: sums[groups])
    found = how.select(search)
    assert (
        {int(g) for g in np.unique(label[found.which])}
        >= {int(label[members[g][0]]) for g in best}
        != set()
    )
    assert found.cost + 4.0 * len(found.which) <= sums[best] * (1 + 1e-9)


def found_on_beam(d, how):
    model = struck_beam.model(0.003)
    pushed = bs.forces.forces_as_inputs(model, list(struck_beam.FORCES))
    data = bs.simulate(pushed, d, dt=struck_beam.DT, sigma_y=1e-5, seed=2)
    made = bs.CompressiveSensingMHE(
        bs.Noise(sigma_y=1e-5), bs.Prior(sigma_x0=1e-4), forces=struck_beam.FORCES, lam=1.0
    )
    return bs.forces.find_sparse_forces(made, model, data, selection=how)


@pytest.mark.parametrize("place", [4, 6])
def test_a_place_that_is_pushed_all_the_time(place):
    d = np.zeros((SAMPLES, 8))
    d[:, place] = 6 * np.sin(0.4 * np.arange(SAMPLES)) + 2
    found = found_on_beam(d, bs.forces.GreedyGroups(span="recording"))
    assert np.flatnonzero(found["d_hat"].values.any(axis=0)).tolist() == [place]
    error = np.abs(found["d_hat"].values - d)[:-3]  # the last are not yet seen
    assert (error <= 4 * found["d_std"].values[:-3]).all()
    assert np.median(error[:, place]) < 0.5


def test_forces_along_the_axes_of_a_node_come_together():
    d = np.zeros((SAMPLES, 8))
    d[9, 2:4], d[19, 6:8] = (7.0, -4.0), (-6.0, 3.0)
    axes = tuple(struck_beam.FORCES[i : i + 2] for i in (0, 2, 4, 6))
    found = found_on_beam(d, bs.forces.GreedyGroups(groups=axes))
    assert ((found["d_hat"].values != 0) == (d != 0)).all()
    assert np.abs(found["d_hat"].values - d).max() < 0.4


@pytest.mark.parametrize(
    "dictionary",
    [
        bs.forces.HalfSines((4,)), bs.forces.Haversines((5,)), bs.forces.Splines((4,)),
        bs.forces.Decays((2,)), bs.forces.SteadyLoads(length=25),
    ],
    ids=lambda d: type(d).__name__,
)  # fmt: skip
def test_forces_of_every_course_are_found(dictionary):
    """Two of each at different places, one after the other."""
    shape, d = dictionary.shapes(4), np.zeros((25, 4))
    for place, begin, size in ((1, 3, 8.0), (3, 12, -6.0)):
        course = size * shape[:, : 25 - begin, place].T
        d[begin : begin + len(course)] += course
    model = struck.model(struck.system())
    pushed = bs.forces.forces_as_inputs(model, list(struck.FORCES))
    inputs = np.hstack([np.zeros((25, 1)), d])
    data = bs.simulate(pushed, inputs, dt=struck.DT, sigma_y=1e-4, seed=2)
    made = bs.CompressiveSensingMHE(
        bs.Noise(sigma_y=1e-4), bs.Prior(P0=struck.P0), forces=struck.FORCES, lam=1.0,
        dictionary=dictionary,
    )  # fmt: skip
    how = bs.forces.Greedy(penalty=20.0)
    found = bs.forces.find_sparse_forces(made, model, data, selection=how)
    assert found.attrs["nonzeros"] == 2
    assert np.abs(found["d_hat"].values - d).max() < 0.3


def test_what_groups_cannot_have_is_refused():
    search, how = searched("step", nonnegative=struck.FORCES[:1])
    with pytest.raises(TuningError, match="knows no signs"):
        how.select(search)
    free, _ = searched("step")
    with pytest.raises(TuningError, match="'G' is none of the forces"):
        bs.forces.GreedyGroups(groups=(("G",),)).select(free)

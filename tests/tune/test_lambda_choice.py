"""Weights of the l1 norm that are chosen without knowing the forces."""

import dataclasses
import functools

import numpy as np
import pytest

import backsight as bs
from backsight.errors import DataError, TuningError
from backsight.models.views.some_outputs import some_outputs
from backsight.plot import force_path_figure, save
from oracles import struck_beam
from tune.struck_beam_recordings import estimator, recording


def found(lam: float, given):
    made = dataclasses.replace(estimator(), lam=lam)
    return bs.forces.find_sparse_forces(
        made, struck_beam.model(0.003), given, selection=bs.forces.L1()
    )


def test_noise_alone_makes_a_force_as_seldom_as_wanted():
    model, made, alarms = struck_beam.model(0.003), estimator(), 0
    lam = bs.tune.lambda_from_noise(made, model, recording(), false_alarm=0.2).lam
    for seed in range(25):
        noise = recording(1e-5, seed, background=0.0739**0.5, hits=0.0)
        alarms += bs.tune.trace_force_path(made, model, noise, least=0.9)["lam"].values[0] > lam
    assert 1 <= alarms <= 11
    assert bs.tune.lambda_from_noise(made, model, recording(), false_alarm=0.01).lam > lam


@pytest.mark.parametrize(
    "choose",
    [
        bs.tune.lambda_from_whiteness,
        bs.tune.lambda_from_sensors,
        functools.partial(bs.tune.lambda_from_pairs, points=12, pairs=1),
        bs.tune.lambda_from_scaled_noise,
    ],
)
def test_the_hits_are_found_with_the_weight_that_is_chosen(choose):
    given, true = recording(1e-5, 2, background=0.0739**0.5), struck_beam.forces()
    choice = choose(estimator(), struck_beam.model(0.003), given)
    assert choice.reached
    largest = bs.tune.trace_force_path(estimator(), struck_beam.model(0.003), given)["lam"].values[
        0
    ]
    assert 0.02 * largest < choice.lam < 0.7 * largest
    errors = bs.forces.compare_forces(found(choice.lam, given)["d_hat"], true, least=1.0, places=1)
    assert not errors.missed
    assert errors.false_alarms <= 2


def test_weight_is_a_value_of_a_fit():
    given, model = recording(1e-5, 2, background=0.0739**0.5), struck_beam.model(0.003)
    tuned = bs.tune.fit(estimator(), model, given, free=["lam"])
    choice = bs.tune.lambda_from_scaled_noise(estimator(), model, given)
    lam = tuned.values["lam"]
    assert lam == pytest.approx(choice.lam)
    assert isinstance(tuned.estimator, bs.CompressiveSensingMHE)
    assert tuned.estimator.lam == lam
    # As another draw of noise has it; the criterion is at its minimum.
    other = bs.tune.lambda_from_scaled_noise(estimator(), model, given, seed=1).lam
    assert abs(other - lam) < 3 * np.sqrt(2) * tuned.std["lam"] < 0.4 * lam
    nearby = [dataclasses.replace(estimator(), lam=k * lam) for k in (0.9, 1.1)]
    assert all(bs.tune.fit(e, model, given, free=["lam"]).before > tuned.cost for e in nearby)
    assert not tuned.doubts
    with pytest.raises(TuningError, match="free lam alone"):
        bs.tune.fit(estimator(), model, given, free=["lam", "sigma_y"])


@pytest.mark.parametrize("factor", [0.2, 4.0])
def test_the_size_of_the_noise_need_not_be_known(factor):
    given, model, right = recording(1e-5, 2), struck_beam.model(0.003), estimator()
    whole = dataclasses.replace(right, sigma_force=factor * right.sigma_force)
    wrong = dataclasses.replace(
        whole,
        noise=bs.Noise(sigma_y=factor * right.noise.sigma_y),
        prior=bs.Prior(P0=factor**2 * right.prior.P0),
    )
    one, other = (
        bs.tune.lambda_from_scaled_noise(e, model, given, draws=60) for e in (right, wrong)
    )
    assert other.lam == pytest.approx(one.lam / factor**2, rel=0.02)
    scales = [c.table["scale"].values[-1] for c in (one, other)]
    assert scales[1] == pytest.approx(scales[0] / factor, rel=0.02)
    doubts = bs.tune.fit(wrong, model, given, free=["lam"]).doubts
    assert ["times the noise that is stated" in d for d in doubts] == [True]


def test_a_wrong_model_is_told_from_noise():
    """The noise is stated a hundred times too small: nothing explains the recording."""
    made = struck_beam.estimator(0.003, eps_Q=1e-12, eps_R=1e-14, lam=1.0)
    choice = bs.tune.lambda_from_whiteness(
        made, struck_beam.model(0.0028), recording(1e-5).isel(time=slice(0, 30))
    )
    assert not choice.reached


def test_the_path_is_what_single_weights_give(tmp_path):
    given, model = recording(1e-5), struck_beam.model(0.003)
    path = bs.tune.trace_force_path(estimator(), model, given, least=0.05)
    for k in (1, 5, path.sizes["lam"] - 1):
        made = dataclasses.replace(estimator(), lam=float(path["lam"][k]))
        one = bs.forces.find_sparse_forces(made, model, given, selection=bs.forces.L1(refit=False))
        assert one.attrs["chi2"] == pytest.approx(float(path["chi2"][k]), rel=1e-6)
        for i in range(path.sizes["atom"]):
            atom = path.isel(atom=i)
            value = one["d_hat"].sel(time=atom["moment"], force=atom["place"])
            assert float(value) == pytest.approx(float(path["alpha"][k, i]), abs=1e-6)
    assert path.attrs["kkt"] < 1e-8
    picture = save(force_path_figure(path, lam=10.0), tmp_path / "path.png")
    assert picture.stat().st_size > 10_000


def test_bad_input_is_refused():
    made, model, given = estimator(), struck_beam.model(0.003), recording()
    with pytest.raises(TuningError, match="false_alarm = 2"):
        bs.tune.lambda_from_noise(made, model, given, false_alarm=2.0)
    with pytest.raises(TuningError, match="least is 0"):
        bs.tune.trace_force_path(made, model, given, least=0.0)
    with pytest.raises(DataError, match="one sensor"):
        bs.tune.lambda_from_sensors(
            dataclasses.replace(made, noise=bs.Noise(sigma_y=1e-5)),
            some_outputs(model, ["s1"]),
            given,
        )
    rest = recording() * 0.0
    rest.attrs = given.attrs
    with pytest.raises(DataError, match="without forces"):
        bs.tune.trace_force_path(made, model, rest)


def test_threshold_keeps_noise_out_as_often_as_wanted():
    model, made = struck_beam.model(0.003), estimator(lam=8.0)
    choice = bs.tune.threshold_from_noise(made, model, recording(), false_alarm=0.2)
    shown = dataclasses.replace(made, threshold=choice.threshold)
    noise = [recording(1e-5, seed, background=0.0739**0.5, hits=0.0) for seed in range(25)]
    without, kept = (bs.estimate_many(e, model, noise) for e in (made, shown))
    assert all((r["d_hat"].values != 0).any() for r in without)
    assert 1 <= sum((r["d_hat"].values != 0).any() for r in kept) <= 11
    assert choice.false_alarm(choice.threshold) == pytest.approx(0.2, abs=0.011)
    tuned = bs.tune.fit(made, model, noise[0], free=["threshold"])
    assert tuned.values["threshold"] > choice.threshold  # one in twenty
    with pytest.raises(TuningError, match="draw 100"):
        bs.tune.threshold_from_noise(made, model, noise[0], false_alarm=0.01, draws=20)
    strong = bs.tune.fit(estimator(lam=40.0), model, noise[0], free=["threshold"])
    assert strong.values["threshold"] == 0
    assert "not needed" in strong.doubts[0]


def test_forces_of_the_noise_do_not_come_again():
    """At a small weight what is found in one copy is not found in the other; a hit is."""
    given, model = recording(1e-5, 2, background=0.0739**0.5), struck_beam.model(0.003)
    table = bs.tune.lambda_from_pairs(estimator(), model, given, points=12, pairs=1).table
    chosen = int(table["as_good"].values.argmax())
    assert table["again"].values[chosen] > 0.8 > table["again"].values[-1]
    # The other copy has noise of twice the variance: nobody predicts it better.
    assert 1.2 < table["error"].values[chosen] < 1.6
    assert table["error"].values[-1] > table["error"].values[chosen]

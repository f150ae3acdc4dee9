"""What of a result is kept: the same numbers as in the whole result, and nothing else."""

import dataclasses

import numpy as np
import pytest

from backsight.description import content
from backsight.errors import EstimationError, TuningError
from backsight.estimators import EKF, MHE
from backsight.run.estimation import _prepared, carrying, estimate, estimate_many
from backsight.run.estimation.results import result
from backsight.run.estimation.results.outputs import Outputs
from backsight.schema import Status, check_estimates
from backsight.testing import TrialProblem

PROBLEM = TrialProblem()
METHOD = EKF(PROBLEM.noise, PROBLEM.prior)
DATA = PROBLEM.simulate(90, seed=3, hold="zoh", noisy=True)
DATA.y[20:30] = np.nan
RECORDING = DATA.recording(PROBLEM.model)
WHOLE = estimate(METHOD, PROBLEM.model, RECORDING, engine="vm")


def same(a, b):
    np.testing.assert_allclose(a.values, b.values, rtol=1e-12, atol=0.0)


@pytest.mark.parametrize("engine", ["vm", "native"])
def test_only_what_is_asked_for_is_there_and_it_is_the_same(engine):
    some = estimate(METHOD, PROBLEM.model, RECORDING, engine=engine, outputs=["x_std", "e", "y"])
    assert set(some.data_vars) == {"x_hat", "status", "x_std", "e", "y"}
    for name in some.data_vars:
        size = np.nanmax(np.abs(WHOLE[name]))
        np.testing.assert_allclose(some[name], WHOLE[name], rtol=1e-9, atol=1e-12 * size)
    assert some["x_std"].attrs == WHOLE["x_std"].attrs
    assert some.coords.equals(WHOLE.coords)


def test_deviation_of_the_innovation_is_the_root_of_its_variance():
    some = estimate(METHOD, PROBLEM.model, RECORDING, engine="vm", outputs=["e_std", "S"])
    assert "e_std" not in WHOLE
    np.testing.assert_allclose(some["e_std"], np.sqrt(np.einsum("kii->ki", WHOLE["S"])), rtol=1e-12)
    assert some["e_std"].dims == ("time", "output")


def test_every_seventh_sample_in_single_precision():
    thin = Outputs(("x_std", "y", "u"), every=7, dtype="float32")
    some = estimate(METHOD, PROBLEM.model, RECORDING, engine="vm", outputs=thin)
    assert some.sizes["time"] == 13
    same(some["time"], WHOLE["time"][::7])
    for name in ("x_hat", "x_std", "y", "u"):
        assert some[name].dtype == np.float32
        np.testing.assert_array_equal(some[name], WHOLE[name][::7].astype(np.float32))
    assert some.attrs["dt"] == pytest.approx(7 * WHOLE.attrs["dt"])
    assert some.attrs["every"] == 7


@pytest.mark.parametrize("method", [METHOD, MHE(PROBLEM.noise, PROBLEM.prior, N=2, lag="N")])
def test_results_do_not_depend_on_blocks_also_with_a_lag(monkeypatch, method):
    """Blocks that are shorter than the lag, and none that fits the samples that are kept."""
    short, thin = RECORDING.isel(time=slice(0, 25)), Outputs(every=4)
    whole = estimate(method, PROBLEM.model, short, engine="vm", outputs=thin)
    for block in (1, 7):
        monkeypatch.setattr(carrying, "VM_BLOCK", block)
        parts = estimate(method, PROBLEM.model, short, engine="vm", outputs=thin)
        assert parts.drop_attrs().identical(whole.drop_attrs())


def test_machine_code_puts_results_into_their_places_in_any_blocks(monkeypatch):
    whole = estimate(METHOD, PROBLEM.model, RECORDING, engine="native")
    for block in (1, 7, 89):
        monkeypatch.setattr(carrying, "BLOCK", block)
        parts = estimate(METHOD, PROBLEM.model, RECORDING, engine="native")
        assert parts.drop_attrs().identical(whole.drop_attrs())


def test_a_result_is_what_the_constructor_of_xarray_makes(monkeypatch):
    quick = estimate(METHOD, PROBLEM.model, RECORDING, engine="vm")
    monkeypatch.setattr(result, "_DIRECT", None)
    plain = estimate(METHOD, PROBLEM.model, RECORDING, engine="vm")
    quick.attrs["seconds"] = quick.attrs["us_per_sample"] = 0.0
    plain.attrs["seconds"] = plain.attrs["us_per_sample"] = 0.0
    assert quick.identical(plain)
    assert dict(quick.sizes) == dict(plain.sizes)
    assert quick.sel(state=PROBLEM.model.states[0].name).sizes["time"] == 90
    again = estimate(METHOD, PROBLEM.model, RECORDING, engine="vm")
    quick["state_unit"].attrs["mine"] = 1
    assert "mine" not in again["state_unit"].attrs


def test_what_happens_at_samples_that_are_not_kept_is_told():
    hit = RECORDING.copy(deep=True)
    hit["u"][43] = 1e308  # samples 0, 40 and 80 are kept
    with pytest.raises(EstimationError, match="failed at sample"):
        estimate(METHOD, PROBLEM.model, hit, engine="vm", outputs=Outputs(every=40))
    some = estimate(
        METHOD, PROBLEM.model, hit, engine="vm", outputs=Outputs(every=40), restart=True
    )
    assert [bool(s & Status.NOT_FINITE) for s in some["status"].values] == [False, False, True]


def test_what_happens_after_the_last_sample_that_is_kept_is_told():
    hit = RECORDING.copy(deep=True)
    hit["u"][85] = 1e308
    some = estimate(METHOD, PROBLEM.model, hit, engine="vm", outputs=Outputs(every=40), throw=False)
    assert [bool(s & Status.NOT_FINITE) for s in some["status"].values] == [False, False, True]


def test_wrong_outputs_are_refused():
    with pytest.raises(TuningError, match="there is no variable 'x_sd', did you mean 'x_std'"):
        estimate(METHOD, PROBLEM.model, RECORDING, outputs=["x_sd"])
    with pytest.raises(TuningError, match="variables is empty"):
        estimate(METHOD, PROBLEM.model, RECORDING, outputs=[])
    with pytest.raises(TuningError, match="every is 0"):
        Outputs(every=0)
    with pytest.raises(TuningError, match="float16"):
        Outputs(dtype="float16")
    some = estimate(METHOD, PROBLEM.model, RECORDING, engine="vm", outputs=["x_std"])
    with pytest.raises(Exception, match=r"no variable 'y_hat'.*outputs="):
        check_estimates(some, "the result")


def test_many_keep_the_same():
    shorter = RECORDING.isel(time=slice(0, 61))
    thin = Outputs(("x_std",), every=3)
    found = estimate_many(METHOD, PROBLEM.model, [RECORDING, shorter], outputs=thin)
    for recording, some in zip((RECORDING, shorter), found, strict=True):
        alone = estimate(METHOD, PROBLEM.model, recording, engine="native", outputs=thin)
        assert set(some.variables) == set(alone.variables)
        np.testing.assert_allclose(some["x_std"], alone["x_std"], rtol=1e-9)


def test_a_compiled_estimator_is_kept_for_what_says_the_same():
    def made(sigma):
        noise = dataclasses.replace(PROBLEM.noise, sigma_y=None, R=sigma**2 * np.eye(2))
        method = EKF(noise, PROBLEM.prior)
        return method, _prepared.compile_once(method, PROBLEM.model, 0.02, outputs=Outputs())

    (first, a), (_, b), (_, c) = made(0.1), made(0.1), made(0.2)
    assert a is b
    assert a is not c
    first.noise.R[0, 0] = 0.04  # frozen, but NumPy lets it be
    changed = _prepared.compile_once(first, PROBLEM.model, 0.02, outputs=Outputs())
    assert changed is not a


def test_content_tells_classes_of_one_name_apart():
    def named_alike():
        return type("Own", (), {"__module__": __name__, "__qualname__": "Own"})

    one, other = named_alike(), named_alike()
    assert content(one, 1.0) == content(one, 1.0)
    assert content(one, 1.0) != content(other, 1.0)
    held = 3
    assert content(lambda: held) is None

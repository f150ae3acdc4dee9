"""The contract suite for outsiders finds what is broken, and says what."""

import dataclasses
import subprocess
import sys
from typing import ClassVar

import casadi as ca
import numpy as np
import pytest

import backsight as bs
from backsight.estimators.base import AbstractEstimator
from backsight.models.model import Model
from backsight.testing import CHECKS, check_estimator, check_model, check_reader

QUICK = {"engines": ["vm"], "holds": ["zoh"]}


def broken(estimator, **options) -> str:
    with pytest.raises(AssertionError) as caught:
        check_estimator(estimator, **{**QUICK, **options})
    return str(caught.value)


@dataclasses.dataclass(frozen=True)
class Wrapped(bs.EKF):
    """An EKF whose recursion is changed behind its back."""

    key: ClassVar[str] = "wrapped"
    title: ClassVar[str] = "Wrapped"

    def build(self, model, dt):
        recursion = super().build(model, dt)
        step = recursion.step
        given = [ca.MX.sym(step.name_in(i), *step.size_in(i)) for i in range(step.n_in())]
        results = list(step.call(self.given(given)))
        changed = ca.Function("changed", given, self.changed(given, results))
        return dataclasses.replace(recursion, step=changed)

    def given(self, given):
        return given

    def changed(self, given, results):
        return results


@dataclasses.dataclass(frozen=True)
class Deaf(Wrapped):
    """Takes what was not measured for zero."""

    def given(self, given):
        carry, u, y, mask = given
        return [carry, u, y, mask * 0 + 1]


@dataclasses.dataclass(frozen=True)
class Modest(Wrapped):
    """Says that it is twice as exact as it is."""

    def changed(self, given, results):
        carry, x_hat, P, *rest = results
        return [carry, x_hat, P / 4, *rest]


@dataclasses.dataclass(frozen=True)
class Scaled(Wrapped):
    """Adds a thousandth of a unit of length to the estimate."""

    def changed(self, given, results):
        carry, x_hat, *rest = results
        return [carry, x_hat + 1e-3, *rest]


def test_ours_pass():
    check_estimator(bs.EKF, **QUICK)
    check_estimator(bs.KalmanFilter, exact=True, **QUICK)
    noise, prior = bs.Noise(sigma_y=1.0), bs.Prior(sigma_x0=1.0)
    check_estimator(bs.EKF(noise, prior, covariance="discrete"), **QUICK)


@pytest.mark.parametrize(
    ("kind", "names"),
    [
        (Deaf, ["value_under_the_mask_has_no_influence", "start_without_measurements"]),
        (Modest, ["errors_are_as_large_as_the_covariance_says"]),
        (Scaled, ["units_are_irrelevant", "perfect_model_gives_zero_error"]),
    ],
)
def test_what_is_broken_is_named(kind, names):
    told = broken(kind)
    assert told.startswith(f"{kind.__name__} breaks ")
    for name in names:
        assert f"  {name}" in told
    assert "  pure: " not in told
    assert "  pickles: " not in told


def test_expected_failures_are_left_out_and_must_fail():
    told = broken(Modest)
    names = [line[2:].partition(":")[0] for line in told.splitlines() if line[:3].strip()][1:]
    reasons = dict.fromkeys(names, "a bound, not a covariance")
    check_estimator(Modest, expected_failures=reasons, **QUICK)
    told = broken(bs.EKF, expected_failures={"pure": "not so"})
    assert "pure: is kept, although a failure is expected" in told
    with pytest.raises(ValueError, match="there are no checks nonsense"):
        check_estimator(bs.EKF, expected_failures={"nonsense": ""})


def test_a_wrong_description_is_told_at_once():
    class Bare(AbstractEstimator):
        def build(self, model, dt): ...

    told = broken(Bare)
    for message in ("has no 'key'", "has no 'title'", "no frozen dataclass"):
        assert message in told
    assert "not derived from AbstractEstimator" in broken(dict)
    fails = dataclasses.dataclass(frozen=True)(
        type("Fails", (bs.EKF,), {"build": lambda *_: 1 / 0})
    )
    assert "Fails cannot be compiled (zoh): ZeroDivisionError" in broken(fails)


def test_every_check_says_what_it_promises():
    assert len({check.name for check in CHECKS}) == len(CHECKS)
    assert all(check.promise.endswith((".", ";", "not.")) for check in CHECKS)


def test_no_test_framework_is_needed():
    code = "import sys; sys.modules['pytest'] = None; import backsight.testing"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_models_that_cannot_be_estimated_with():
    check_model(bs.sdof(k=1.0, b=1.0))
    root = Model(
        f=lambda x, u, p: [x.a**0.5], h=lambda x, u, p: [0 * x.a + 1, x.a],
        states={"a": ""}, inputs={}, outputs={"y": "", "z": ""},
    )  # fmt: skip
    with pytest.raises(AssertionError, match="the derivative of the rate of a is not finite"):
        check_model(root)
    with pytest.raises(AssertionError, match="the output y depends on no state"):
        check_model(dataclasses.replace(root, f=lambda x, u, p: [x.a]))


@pytest.mark.parametrize(
    ("reader", "message"),
    [
        (lambda path, wanted: [1.0], "columns by name"),
        (lambda path, wanted: {"b": [1.0]}, "'a' is missing"),
        (lambda path, wanted: {"a": [[1.0]]}, "has the shape"),
        (lambda path, wanted: {"a": [1.0], "b": [1.0, 2.0]}, "numbers of samples differ"),
        (lambda path, wanted: {"a": np.random.default_rng().random(3), "b": [1.0]}, "second"),
        (lambda path, wanted: {name: [1.0] for name in wanted}, "not in the file"),
    ],
)
def test_readers_that_are_none(reader, message, tmp_path):
    with pytest.raises(AssertionError, match=message):
        check_reader(reader, tmp_path / "a", columns=["a", "b"])

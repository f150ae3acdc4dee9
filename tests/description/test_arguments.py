"""Arguments of public functions: refused before anything is read or computed."""

import inspect
import typing

import numpy as np
import pytest

import backsight as bs
from backsight.description import Count, Positive, checked, words
from backsight.errors import BacksightError, DataError, EngineError, ModelError, TuningError
from backsight.estimators.base import AbstractEstimator
from backsight.export import export_c
from backsight.models.model import Model
from description.everything import options

MODEL = bs.sdof(k=100.0, b=1.0)
GIVEN = bs.simulate(MODEL, np.zeros(5), dt=0.01)
NOISE, PRIOR = bs.Noise(sigma_y=1.0), bs.Prior(1.0)
EKF = bs.EKF(NOISE, PRIOR)


def functions() -> list[object]:
    """The public functions that take an estimator."""
    rooms = [bs, bs.check, bs.forces, bs.tune, bs.export]
    found = {getattr(room, n) for room in rooms for n in dir(room) if not n.startswith("_")}
    takers = [f for f in found if inspect.isfunction(f)]
    return sorted(
        (f for f in takers if "estimator" in inspect.signature(f).parameters),
        key=lambda f: f.__name__,
    )


@pytest.mark.parametrize("function", functions(), ids=lambda f: f.__name__)
def test_every_argument_of_every_function_with_an_estimator_is_checked(function):
    """None of the arguments means anything, so that all are named, and nothing is compiled."""
    needed = inspect.signature(function).parameters.values()
    wrong = {a.name: object() for a in needed if a.default is a.empty}
    with pytest.raises(BacksightError) as caught:
        function(**wrong)
    assert str(caught.value).startswith(f"{function.__name__}: ")
    for name in wrong:
        assert f"{name} is of the kind object; it must be" in str(caught.value)


def test_functions_that_take_an_estimator_were_found():
    assert {"estimate", "stream", "certify", "rate_sensors"} <= {f.__name__ for f in functions()}


@pytest.mark.parametrize(
    ("call", "refusal", "message"),
    [
        (lambda: bs.estimate(EKF, MODEL, GIVEN, engine="natve"), EngineError, "mean 'native'"),
        (lambda: bs.compare({"a": EKF}, MODEL, GIVEN, engine="VM"), EngineError, "engine 'VM'"),
        (lambda: bs.stream(EKF, MODEL, 0.01, engine="gpu"), EngineError, "'native' or 'vm'|known"),
        (lambda: bs.stream(EKF, MODEL, -0.01), TuningError, r"dt is -0\.01; it must be positive"),
        (lambda: bs.estimate(MODEL, EKF, GIVEN), TuningError, "model is of the kind EKF"),
        (lambda: bs.compare([EKF], MODEL, GIVEN), TuningError, "must be a dict by name"),
        (lambda: bs.estimate_many(EKF, MODEL, GIVEN, threads=0), TuningError, "threads is 0"),
        (lambda: bs.simulate(MODEL, [0.0], dt=0.01, hold="foo"), TuningError, "mean 'foh'"),
        (lambda: bs.simulate(MODEL, [0.0], dt=np.nan), DataError, "sampling period dt is nan"),
        (lambda: bs.simulate(MODEL, [0.0], dt=1.0, seed=-1), DataError, "seed is -1"),
        (lambda: bs.beam(1.0, sensors={}, boundary="free"), ModelError, "mean 'free-free'"),
        (lambda: bs.augment(EKF), ModelError, "augment: model is of the kind EKF"),
        (
            lambda: bs.read("none.csv", inputs={}, outputs={}, skip_lines=-1),
            DataError,
            "skip_lines is -1",
        ),
        (
            lambda: export_c(EKF, MODEL, GIVEN, "nowhere", precision="half"),
            EngineError,
            "'double' or 'float'|known: double",
        ),
    ],
)
def test_wrong_arguments_are_named(call, refusal, message):
    with pytest.raises(refusal, match=message):
        call()


def test_nothing_is_called_with_wrong_arguments():
    called = []

    @checked(DataError)
    def work(count: Count, *, size: Positive = 1.0, other=None) -> int:
        called.append(other)
        return count

    assert work(np.int64(2), other=object()) == 2
    with pytest.raises(DataError, match=r"work: count is 0; .*; size is nan; it must be positive"):
        work(0, size=np.nan)
    with pytest.raises(TypeError, match="count"):
        work()
    assert len(called) == 1


def test_words_of_functions_are_literals():
    for function, name, expected in (
        (bs.estimate, "engine", {"native", "vm"}),
        (bs.simulate, "hold", {"zoh", "foh"}),
        (export_c, "precision", {"double", "float"}),
    ):
        hint = typing.get_type_hints(function, include_extras=True)[name]
        assert {w for o in options(hint) for w in words(o)} == expected


def test_a_third_party_estimator_is_checked_as_well():
    """Its fields by their annotations, without a line of its own."""
    import dataclasses

    @dataclasses.dataclass(frozen=True)
    class Constant(AbstractEstimator):
        gain: Positive

        def build(self, model: Model, dt: float):
            raise NotImplementedError

    with pytest.raises(TuningError, match=r"Constant: gain is -1; it must be positive"):
        Constant(-1)


COMPLEX = np.eye(1) * (-1 + 0.5j)
SIGNALS = {"inputs": {"u": ""}, "outputs": {"y": ""}}


@pytest.mark.parametrize(
    "call",
    [
        lambda: bs.lti(COMPLEX, [[1.0]], [[1.0]], states={"x": ""}, **SIGNALS),
        lambda: bs.from_arrays(dt=0.1, u=[[0.0]], y=COMPLEX, **SIGNALS),
        lambda: bs.from_arrays(dt=0.1, u=[[0.0]], y=np.ma.masked_array(COMPLEX), **SIGNALS),
        lambda: bs.simulate(MODEL, np.zeros((3, 1)) + 1j, dt=0.01),
        lambda: bs.signals.filtered(COMPLEX, b=np.ones(1), a=np.ones(1)),
        lambda: bs.signals.central_difference(COMPLEX, dt=0.1),
        lambda: bs.reduced(np.eye(1), COMPLEX, modes=1, damping=0.01, sensors={}),
        lambda: bs.Prior(P0=COMPLEX),
        lambda: bs.Noise(R=COMPLEX),
    ],
)
def test_half_of_a_complex_number_is_never_left_off(call):
    with pytest.raises(BacksightError, match=r"complex|must be an array of numbers"):
        call()

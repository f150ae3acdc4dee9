"""Parameters that make no sense are told; those that do are not."""

import numpy as np
import pytest

import backsight as bs
from backsight.errors import TuningError
from backsight.run.diagnosis._judges import Judges
from backsight.run.diagnosis.parameters.sense import poles, surprises

DT, N = 0.02, 200
NOISE = bs.Noise(sigma_y=0.02, sigma_w={"w": 1e-3})


def motor(**signal) -> bs.Model:
    plain = bs.Model(
        f=lambda x, u, p: [(u.M - p.b * x.w) / p.J], h=lambda x, u, p: [x.w],
        states={"w": "rad/s"}, inputs={"M": "N m"}, outputs={"y": "rad/s"},
        parameters={"J": bs.Signal("kg m2", value=1e-3, **signal), "b": 2e-3},
    )  # fmt: skip
    return bs.augment(plain, ["J", "b"])


def recording(J: float = 1.2e-3):
    u = 0.02 * np.sign(np.sin(0.15 * np.arange(N)))
    plain = bs.Model(
        f=lambda x, u, p: [(u.M - 2e-3 * x.w) / p.J], h=lambda x, u, p: [x.w], states={"w": ""},
        inputs={"M": "N m"}, outputs={"y": "rad/s"}, parameters={"J": J},
    )  # fmt: skip
    return bs.simulate(plain, u, dt=DT, sigma_y=0.02, seed=3)


def prior(J: float) -> bs.Prior:
    return bs.Prior({"w": 0.1, "J": J, "b": 1e-3})


def test_a_prior_that_reaches_a_pole_is_told_before_the_run():
    (told,) = poles(bs.EKF(NOISE, prior(1e-3)), motor())
    assert told.startswith("J: its prior, 0.00100 ± 0.0010, reaches zero")
    assert poles(bs.EKF(NOISE, prior(2e-4)), motor()) == []
    assert poles(bs.EKF(NOISE, prior(1e-3)), motor(positive=True)) == []


def told_of(e, model, data) -> str:
    return judged(e, model, data, bs.estimate(e, model, data, engine="vm"))


def judged(e, model, data, result) -> str:
    judges = Judges(model, data, {"": result}, {"": e})
    return "; ".join(surprises(e, judges, result))


def test_what_makes_sense_is_not_told():
    assert told_of(bs.EKF(NOISE, prior(2e-4)), motor(), recording()) == ""


def test_a_value_far_from_its_prior_is_told():
    assert "J ended" in (told := told_of(bs.EKF(NOISE, prior(2e-5)), motor(), recording()))
    assert "standard deviations of its prior" in told


def test_a_value_on_the_wrong_side_is_told():
    data = recording()
    e = bs.EKF(NOISE, prior(1e-3))
    result = bs.estimate(e, motor(), data, engine="vm")
    result["x_hat"][-1, 1] = -1.8e-3
    assert "J ended at −0.00180, on the other side of zero" in judged(e, motor(), data, result)


def test_a_band_narrower_than_the_data_tell_is_told():
    data = recording()
    e = bs.EKF(NOISE, prior(2e-4))
    result = bs.estimate(e, motor(), data, engine="vm")
    result["x_std"][-1, 1] = 0.3 * result["x_std"][-1, 1]
    assert "J is said to be known" in judged(e, motor(), data, result)


def test_a_trade_off_of_which_a_filter_believes_to_know_both_sides_is_told():
    """J and Ja act by their sum; along it the prior is left, in logarithms of both."""
    sizes = {"J": (8e-4, 4e-4), "Ja": (4e-4, 4e-4)}
    plain = bs.Model(
        f=lambda x, u, p: [(u.M - 2e-3 * x.w) / (p.J + p.Ja)], h=lambda x, u, p: [x.w],
        states={"w": "rad/s"}, inputs={"M": "N m"}, outputs={"y": "rad/s"},
        parameters={n: bs.Signal("kg m2", value=v, positive=True) for n, (v, _) in sizes.items()},
    )  # fmt: skip
    model = bs.augment(plain, ["J", "Ja"])
    e = bs.EKF(NOISE, bs.Prior({"w": 0.1, **{n: s for n, (_, s) in sizes.items()}}))
    data = recording()
    result = bs.estimate(e, model, data, engine="vm")
    told = judged(e, model, data, result)
    # By hand: the logarithms keep their standard deviations along the sum.
    last = result.sel(state=list(sizes)).isel(time=-1)
    along = [
        x * np.sqrt(np.log1p((s / v) ** 2))
        for x, (v, s) in zip(last.x_hat.values, sizes.values(), strict=True)
    ]
    right = 1 / np.hypot(*(1 / np.array(along)))
    assert float(last.x_std[0]) < 0.5 * right
    said = told.partition("the recording tells ± ")[2].split(" at")[0]
    assert float(said.replace(" × 10⁻⁴", "e-4")) == pytest.approx(right, rel=0.1)
    assert "J and Ja in the ratio 1 : -1: only another combination is known" in told


def test_the_profile_has_its_top_at_the_value():
    data = recording()
    e = bs.EKF(NOISE, prior(3e-4))
    values = np.linspace(1.1e-3, 1.3e-3, 13)
    found = bs.check.profile(e, motor(), data, "J", values)
    low, high = found.attrs["interval"]
    assert found.attrs["best"] == pytest.approx(1.2e-3, rel=0.02)
    assert low - 1e-9 <= 1.2e-3 <= high + 1e-9
    assert high - low < 1e-4
    assert found.log_likelihood.sizes == {"value": 13}
    J = found.x_hat.sel(state="J").values
    np.testing.assert_allclose(J, values)
    assert (found.x_std.sel(state="J") == 0).all()
    default = bs.check.profile(bs.EKF(NOISE, prior(1e-3)), motor(positive=True), data, "J")
    assert (default["value"] > 0).all()
    assert default["value"].values[[0, -1]].prod() == pytest.approx(1e-3**2)
    apart = bs.check.profile(e, motor(), data, "J", [1.0e-3, 1.1e-3])
    assert apart.attrs["interval"] == [1.0e-3, np.inf]
    with pytest.raises(TuningError, match="none of the values"):
        bs.check.profile(e, motor(lower=0.0), data, "J", [-1.0])

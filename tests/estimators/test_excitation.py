import casadi as ca
import numpy as np
import pytest

from backsight.errors import TuningError
from backsight.estimators.observers._excitation import (
    BLOCKS,
    Excitation,
    excitation,
    excitation_start,
)
from backsight.models.canonical.affine import affine_form
from backsight.run.estimation import estimate
from backsight.schema import Status
from backsight_studies.punch.plant import SOFT, STIFF
from estimators.punch import joint, motion, observer

DT, LAM, SIGMA = 0.01, 3.0, 1e-3
WINDOW = Excitation(0.4)


@pytest.fixture(scope="module")
def form():
    return affine_form(joint(SOFT))


def advance(form, upsilon, theta):
    """Level and flag after every sample of Upsilon (n, 2, 3)."""
    step = excitation(WINDOW, form, dt=DT, sigma=SIGMA)
    memory = list(excitation_start(WINDOW, DT, 3).values())
    levels, flags = [], []
    for Y in upsilon:
        memory = step(*memory, ca.vec(ca.DM(Y)), LAM, theta)
        level, flag = memory[-2:]
        levels.append(np.asarray(level)[:, 0])
        flags.append(float(flag))
    return np.array(levels), np.array(flags)


def sensitivities(form, upsilon, theta):
    """Innovation by relative change of a parameter, by difference quotients of theta(p)."""
    p = np.asarray(form.physical(theta))[:, 0]
    slopes = []
    for i in range(3):
        moved = p.copy()
        moved[i] *= 1 + 1e-6
        slopes.append((np.asarray(form.theta(moved))[:, 0] - theta) / 1e-6)
    return upsilon[:, 0, :] / LAM**2 @ np.array(slopes).T


def test_level_is_the_part_that_no_other_parameter_explains(form):
    """Least squares of each column on the others, over the last window."""
    rng = np.random.default_rng(0)
    theta = np.array([160.0, 12.0, 0.008])
    upsilon = rng.standard_normal((90, 2, 3)) * [1e-4, 1e-3, 2.0]
    upsilon[:, 0, 1] += 4 * upsilon[:, 0, 0]
    levels, flags = advance(form, upsilon, theta)
    length = 2 * BLOCKS
    for end in (40, 60, 90):
        s = sensitivities(form, upsilon[end - length : end], theta)
        for i in range(3):
            others = np.delete(s, i, axis=1)
            fitted = others @ np.linalg.lstsq(others, s[:, i], rcond=None)[0]
            own = np.sqrt(np.mean((s[:, i] - fitted) ** 2))
            assert levels[end - 1, i] == pytest.approx(own, rel=1e-4)
    assert flags.all()


def test_a_column_that_is_not_moved_is_not_excited(form):
    upsilon = np.random.default_rng(1).standard_normal((60, 2, 3))
    upsilon[:, 0, form.combinations.index("d/m")] = 0.0
    levels, flags = advance(form, upsilon, np.array([160.0, 12.0, 0.008]))
    assert flags[:39].all()
    assert not flags[39:].any()
    assert levels[-1, form.parameters.index("d")] < 1e-6 * levels[-1].max()


def test_the_strokes_excite_spring_and_damper_by_their_stiffness():
    """With the soft spring the spring is the weak one, with the stiff spring the damper."""
    for reading, lam, weak, strong in ((SOFT, 300.0, "c", "d"), (STIFF, 1000.0, "d", "c")):
        recording = motion(reading)
        result = estimate(observer(1.0, reading=reading, lam=lam), joint(reading), recording)
        level = dict(zip(result["parameter"].values, result["excitation"].values[-1], strict=True))
        assert level[weak] < level[strong]
        assert not (result["status"].values & int(Status.NOT_EXCITED)).any()


def test_wrong_window():
    with pytest.raises(TuningError, match="the window of the excitation is -1 s"):
        Excitation(-1)

"""Dictionaries: what they offer, against integrals and motions worked out by other routes."""

import numpy as np
import pytest
import scipy

from backsight.errors import TuningError
from backsight.estimators.dictionaries import (
    Decays,
    ForceLine,
    HalfSines,
    Haversines,
    Impulses,
    MovingLoads,
    Splines,
    SteadyLoads,
)

PULSES = {
    "impulses": (Impulses(), 1),
    "half-sines": (HalfSines((2, 5)), 5),
    "haversines": (Haversines((5,)), 5),
    "splines": (Splines((8,)), 8),
    "decays": (Decays((3,)), 3),
    "steps": (SteadyLoads(7), 7),
}
PLACES = (1.0, 2.0, 3.0, 4.5)


@pytest.mark.parametrize("name", PULSES)
def test_the_impulse_is_the_integral_of_the_course(name):
    pulses, width = PULSES[name]
    s = np.linspace(0, pulses.lasts, 4001)
    area = scipy.integrate.cumulative_simpson(pulses.course(s), x=s, initial=0)
    np.testing.assert_allclose(pulses.impulse(s), area, atol=1e-9)
    assert abs(pulses.course(s).max() - 1) < 1e-9

    # Means over samples, of a pulse that begins anywhere: no force is lost between the samples.
    edges = np.arange(60.0)
    means = pulses.means(edges, start=3.3, width=width)
    assert abs(means.sum() - width * area[-1]) < 1e-9
    assert not means[:3].any()
    assert not means[4 + pulses.lasts * width :].any()
    moment = scipy.integrate.simpson(s * pulses.course(s), x=s) / area[-1]
    assert abs(pulses.middle(start=3.3, width=width) - (3.3 + width * moment)) < 1e-4


@pytest.mark.parametrize("name", PULSES)
def test_atoms_are_the_course_in_the_middle_of_every_step(name):
    pulses, width = PULSES[name]
    atoms = pulses.shapes(3)
    assert pulses.force_of(3) == [0, 1, 2] * len(pulses.lengths)
    steps = pulses.lasts * width
    middle = pulses.course((np.arange(steps) + 0.5) / width)
    np.testing.assert_allclose(atoms[1, :steps, -2], middle, atol=1e-12)
    assert not atoms[1, steps:, -2].any()


def test_smooth_forces_are_sums_of_splines():
    """B-splines at every knot make a constant."""
    spline = Splines((8,)).shapes(1)[0, :, 0]
    total = np.zeros(48)
    for begin in range(0, 40, 2):
        total[begin : begin + 8] += spline
    np.testing.assert_allclose(total[8:38], total[8], rtol=1e-12)


def test_a_line_interpolates_the_shapes():
    line = ForceLine(PLACES, supports=(0.0, 6.0))
    np.testing.assert_allclose(line.weights(np.array(PLACES)), np.eye(4), atol=1e-12)
    assert not line.weights(np.array([-0.1, 6.1])).any()
    np.testing.assert_allclose(line.weights(np.array([0.0, 6.0])), 0, atol=1e-12)

    def shape(x):  # a cubic that is zero at the supports
        return x * (6 - x) * (x + 2)

    x = np.linspace(0, 6, 31)
    found = line.weights(x) @ shape(np.array(PLACES))
    np.testing.assert_allclose(found, shape(x), atol=1e-11)
    turned = ForceLine(PLACES[::-1], supports=(6.0, 0.0))
    np.testing.assert_allclose(turned.weights(x), line.weights(x)[:, ::-1], atol=1e-12)


@pytest.mark.parametrize("crossing", [24, -24])
def test_a_load_moves_from_end_to_end(crossing):
    line = ForceLine(PLACES, supports=(0.0, 6.0))
    atom = MovingLoads(line, (crossing, 30)).shapes(4)[:, :, 0]
    assert atom.shape == (4, 30)
    assert not atom[:, 24:].any()
    # What every step does to a cubic shape is its mean over the way that was gone.
    moments = np.linspace(0, 24, 24 * 200 + 1)
    x = 6 * (moments[1:] + moments[:-1]) / 2 / 24
    shape = x * (6 - x) * (x + 2)
    mean = (shape if crossing > 0 else shape[::-1]).reshape(24, 200).mean(axis=1)
    nodes = np.array(PLACES)
    moved = (nodes * (6 - nodes) * (nodes + 2)) @ atom[:, :24]
    if crossing < 0:
        back = 6 - x
        mean = (back * (6 - back) * (back + 2)).reshape(24, 200).mean(axis=1)
    np.testing.assert_allclose(moved, mean, atol=0.02)


@pytest.mark.parametrize(
    ("made", "message"),
    [
        (lambda: Haversines(()), r"widths is \(\)"),
        (lambda: SteadyLoads(0), "length"),
        (lambda: ForceLine((1.0,)), "two places or more"),
        (lambda: ForceLine((1.0, 2.0), supports=(2.0,)), "2 m, which is a support, moves nothing"),
        (lambda: MovingLoads(ForceLine(PLACES), (0, 3)), "other than 0"),
        (lambda: MovingLoads(ForceLine(PLACES), (3,)).shapes(5), "4 places; there are 5 forces"),
    ],
)
def test_what_is_no_dictionary_is_refused(made, message):
    with pytest.raises(TuningError, match=message):
        made()

"""Blind calibration: the beam's own values from a recording of unknown hits."""

import numpy as np
import pytest

import backsight as bs
from backsight.errors import TuningError
from backsight.models.structures._beam_modes import shapes
from oracles import struck_beam
from tune.struck_beam_recordings import estimator, recording

THIN = {"f1": 7.8811, "f2": 49.3902, "f3": 138.2939}
TRUE = {"f1": 8.75680, "f2": 54.8780, "f3": 153.6599}


def by_thickness(values):
    return struck_beam.model(values["h"])


def by_frequencies(values):
    """With the modal masses of a beam that is a tenth too thin."""
    of, mass = shapes("cantilever", 3), 0.025 * 0.0027 * 7502.0 * 0.405

    def row(x):
        return of.at(x / 0.405)[0] / np.sqrt(mass)

    return bs.modal(
        [values[n] for n in THIN],
        damping=[0.030, 0.037, 0.119],
        sensors={
            f"s{i + 1}": ("displacement", row(x)) for i, x in enumerate((0.245, 0.325, 0.405))
        },
        forces={n: row(x) for n, x in zip(struck_beam.FORCES, struck_beam.NODES, strict=True)},
    )


def test_thickness_and_forces_are_found_from_a_tenth_away():
    start = estimator(0.0027)
    wrong = bs.forces.find_sparse_forces(start, struck_beam.model(0.0027), recording())
    found = bs.tune.calibrate(start, by_thickness, recording(), {"h": 0.0027}, points=9)
    assert found.values["h"] == pytest.approx(0.003, rel=1e-9)
    assert found.cost < 0.5 * found.before
    forces = bs.forces.find_sparse_forces(start, found.model, recording())
    np.testing.assert_allclose(forces["d_hat"], struck_beam.forces(), atol=1e-6)
    assert not bs.forces.compare_forces(wrong["d_hat"], struck_beam.forces()).exact


@pytest.mark.parametrize(
    "selection", [bs.forces.Greedy(), pytest.param(bs.forces.L1(), marks=pytest.mark.slow)]
)
def test_frequencies_are_found_without_noise(selection):
    """To better than a ten-thousandth; the wrong modal mass goes into the size of the forces."""
    made = estimator(0.0027, lam=1.0)
    found = bs.tune.calibrate(
        made, by_frequencies, recording(), THIN, points=5, selection=selection
    )
    for name, value in TRUE.items():
        assert found.values[name] == pytest.approx(value, rel=1e-5)


def test_frequencies_are_as_sure_as_it_says():
    """With 10 um of noise; a calibration that starts there says so and stays."""
    found = bs.tune.calibrate(estimator(0.0027), by_frequencies, recording(1e-5), THIN, points=5)
    for name, value in TRUE.items():
        assert abs(found.values[name] - value) < 3 * found.std[name]
        assert found.std[name] < 0.03 * value
    np.testing.assert_allclose(np.diag(found.correlation), 1)
    assert found.forces == 4
    again = bs.tune.calibrate(
        recording(1e-5), estimator(0.0027), by_frequencies, found.values, points=5, span=0.02
    )
    for name, value in found.values.items():
        assert again.values[name] == pytest.approx(value, rel=1e-4)
    assert "f1 = 8.7" in str(found)
    assert "4 atoms" in str(found)


def test_other_minima_are_named():
    scan = bs.tune.calibrate(estimator(), by_thickness, recording(), {"h": 0.003}, points=5).scan
    assert list(scan["scale"].values) == pytest.approx([0.8, 0.9, 1.0, 1.1, 1.2])
    from backsight.tune.calibration import _rival

    assert _rival(np.arange(5.0), np.array([9.0, 2.0, 5.0, 3.0, 4.0])) == (3.0, 1.0)
    assert _rival(np.arange(3.0), np.array([9.0, 2.0, 5.0]))[0] is None


def test_bad_input_is_refused():
    made, given = estimator(), recording()
    with pytest.raises(TuningError, match="positive values"):
        bs.tune.calibrate(made, by_thickness, given, {"h": -1.0})
    with pytest.raises(TuningError, match="span"):
        bs.tune.calibrate(made, by_thickness, given, {"h": 0.003}, span=2.0)
    with pytest.raises(TuningError, match="no force was found"):
        bs.tune.calibrate(
            made,
            by_thickness,
            given,
            {"h": 0.003},
            points=3,
            selection=bs.forces.Greedy(penalty=1e9),
        )

    def twice(values):
        return struck_beam.model(values["a"] * values["b"])

    with pytest.raises(TuningError, match="does not determine a, b"):
        bs.tune.calibrate(made, twice, given, {"a": 0.003, "b": 1.0}, points=3, span=0.01)

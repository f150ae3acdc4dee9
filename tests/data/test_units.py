"""Units: what is one, what becomes what, and that signals arrive in the unit that is asked for."""

import math
import sys

import numpy as np
import pytest

import backsight as bs
import small_problem
from backsight.data import convert_units, from_arrays, read
from backsight.errors import DataError
from backsight.problem.reading.loading import load
from backsight.problem.recorded import recording_of
from backsight.units import UnitError, check_unit, conversion


@pytest.mark.parametrize(
    "unit",
    [
        *(
            "",
            "-",
            "1",
            "um",
            "µm",
            "1/s2",
            "um/s2/V",
            "kg/m3",
            "kN m",
            "Nm",
            "N·m",
            "m/s²",
            "m/s^2",
        ),
        *("°C", "Volts", "grav", "rpm", "%", "N s/m", "N/(m s)", "kg m^2", "kips", "mV/V", "ohm"),
    ],
)
def test_what_engineers_write_is_a_unit(unit):
    check_unit(unit)


@pytest.mark.parametrize(
    "text", ["banana", "length/s2", "9**9**9**9", "m**9**9", "__import__('os')", "m" * 200, "N;m"]
)
def test_anything_else_is_refused_at_once(text):
    with pytest.raises(UnitError, match="is no unit"):
        check_unit(text)


@pytest.mark.parametrize(
    ("given", "wanted", "factor", "offset"),
    [
        ("mm", "m", 1e-3, 0.0),
        ("Nm", "N mm", 1e3, 0.0),
        ("rpm", "rad/s", math.pi / 30, 0.0),
        ("degC", "K", 1.0, 273.15),
        ("deg", "rad", math.pi / 180, 0.0),
        ("grav", "m/s2", 9.80665, 0.0),
        ("g", "m/s2", 9.80665, 0.0),
        ("g", "kg", 1e-3, 0.0),
        ("kHz", "1/s", 1e3, 0.0),
        ("in", "mm", 25.4, 0.0),
        ("ue", "", 1e-6, 0.0),
        ("Volts", "V", 1.0, 0.0),
    ],
)
def test_conversions(given, wanted, factor, offset):
    assert conversion(given, wanted) == pytest.approx((factor, offset), rel=1e-12)
    if not offset:
        assert conversion(wanted, given).factor == pytest.approx(1 / factor, rel=1e-12)


@pytest.mark.parametrize(
    ("given", "wanted"),
    [("mm", "N"), ("Hz", "rad/s"), ("rpm", "Hz"), ("rpm", "1/s"), ("cts", "kg"), ("Nm", "m/kg")],
)
def test_what_is_not_the_same_is_not_converted(given, wanted):
    with pytest.raises(UnitError, match="cannot be converted"):
        conversion(given, wanted)


@pytest.fixture
def path(tmp_path):
    file = tmp_path / "run.csv"
    file.write_text("t [ms],y [mm],F [kN]\n0,1,2\n10,3,4\n20,5,6\n")
    return file


def test_columns_come_in_the_unit_that_is_asked_for(path):
    columns = {"inputs": {"F": bs.data.Column("F", unit="N")}, "time": "t"}
    recording = read(path, outputs={"y": {"name": "y", "unit": "um"}}, **columns)
    assert recording.y.values.ravel().tolist() == [1e3, 3e3, 5e3]
    assert recording.u.values.ravel().tolist() == [2e3, 4e3, 6e3]
    assert recording.attrs["dt"] == pytest.approx(0.01)
    plain = read(path, outputs={"y": "y"}, **columns)
    assert (plain.output_unit.item(), plain.y.values[1, 0]) == ("mm", 3.0)
    given = read(path, outputs={"y": {"name": "y", "unit": "um", "factor": 2.0}}, **columns)
    assert given.y.values[1, 0] == 6.0
    other = read(path, outputs={"y": {"name": "y", "unit": "V"}}, **columns)
    assert other.y.values[1, 0] == 3.0
    assert "'y' is taken in V, though the file says mm" in other.attrs["understood"]


def test_a_problem_takes_its_recording_in_the_units_of_the_model(tmp_path):
    plain = recording_of(load(small_problem.write(tmp_path)))
    text = small_problem.changed('"m" }', '"mm", factor = 1e3 }')
    converted = recording_of(load(small_problem.write(tmp_path, text)))
    assert converted.output_unit.item() == "m"
    np.testing.assert_allclose(converted.y, plain.y, rtol=1e-15)


def test_recordings_are_converted_by_name():
    recording = from_arrays(
        u=[20.0, 30.0],
        y=[[1.0, 7.0], [2.0, 8.0]],
        dt=1.0,
        inputs={"T": "degC"},
        outputs={"q": "mm", "c": "banana"},
    )
    other = convert_units(recording, {"q": "m", "T": "K", "c": "V"})
    assert other.u.values.ravel().tolist() == [293.15, 303.15]
    assert other.y.values[:, 0].tolist() == [1e-3, 2e-3]
    assert recording.y.values[0, 0] == 1.0
    with pytest.raises(DataError, match="output 'q': 'mm' cannot be converted to 'N'"):
        convert_units(recording, {"q": "N"})


def test_common_units_do_not_need_the_library(monkeypatch):
    monkeypatch.setitem(sys.modules, "pint", None)
    for unit in ("N", "mm", "kg/m3", "um/s2/V", "rad/s", ""):
        check_unit(unit)
    assert conversion("mm", "mm").same


def test_an_estimator_takes_no_millimetres_for_metres():
    model = bs.sdof(k=100.0, b=1.0)
    data = from_arrays(u=np.zeros(5), y=np.zeros(5), dt=0.01, inputs={"u": ""}, outputs={"y": "mm"})
    ekf = bs.EKF(bs.Noise(sigma_y=1.0), bs.Prior(1.0))
    with pytest.raises(DataError, match=r"output 'y' is in mm, the model takes m; .*convert_units"):
        bs.estimate(ekf, model, data, engine="vm")
    assert bs.estimate(ekf, model, convert_units(data, {"y": "m"}), engine="vm").sizes["time"] == 5
    other = data.assign_coords(output_unit=("output", ["Pa"]))
    with pytest.raises(DataError, match="output 'y' is in Pa, the model takes m, which is another"):
        bs.estimate(ekf, model, other, engine="vm")


@pytest.mark.parametrize(
    ("given", "wanted", "factor"),
    [
        *((u, "m/s^2", 9.80665) for u in ("g", "G", "gn", "g_n", "grav")),
        ("mg", "m/s²", 9.80665e-3),
        ("g²/Hz", "m^2/s^3", 9.80665**2),
        *((u, "Nm", 1.0) for u in ("N*m", "N.m", "N-m", "N·m", "N⋅m", "N×m", "N m")),
        *((u, "N mm", f) for u, f in (("mNm", 1.0), ("Ncm", 10.0), ("daNm", 1e4), ("MNm", 1e9))),
        ("ft-lb", "Nm", 1.3558179483314),
        ("lb", "N", 4.4482216152605),
        ("kNs/m", "N s/m", 1e3),
        ("kgm²", "kg m^2", 1.0),
        ("gmm", "kg m", 1e-6),
        *((u, "rad/s", math.pi / 30) for u in ("rpm", "RPM", "U/min", "r/min", "rev/min")),
        *((u, "rad/s", math.pi / 180) for u in ("deg/s", "°/s", "dps")),
        ("1/min", "1/s", 1 / 60),
        ("mil", "µm", 25.4),
        ("KN", "N", 1e3),
        ("‰", "%", 0.1),
        ("kmh", "m/s", 1 / 3.6),
        ("°C/s", "K/s", 1.0),
    ],
)
def test_spellings_of_engineers_have_their_factors(given, wanted, factor):
    found = conversion(given, wanted)

    assert found.factor == pytest.approx(factor, rel=1e-9)
    assert found.offset == 0.0


@pytest.mark.parametrize("unit", ["°C", "degC", "Deg C", "℃", "Celsius", "C"])
def test_degrees_of_celsius_keep_their_offset(unit):
    assert conversion(unit, "K") == pytest.approx((1.0, 273.15))


@pytest.mark.parametrize(
    ("given", "wanted"),
    [("1/min", "rad/s"), ("1/min", "rpm"), ("Hz", "rad/s"), ("dB", "1"), ("kg", "N"), ("Np", "1")],
)
def test_what_has_no_factor_that_is_sure_is_refused(given, wanted):
    with pytest.raises(UnitError, match=r"converted|logarithmic"):
        conversion(given, wanted)


def test_a_unit_of_the_file_that_leads_nowhere_is_said(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("t [s],p [psig]\n0,1\n1,2\n2,3\n")

    recording = read(path, time="t", inputs={}, outputs={"p": {"name": "p", "unit": "Pa"}})

    assert recording.attrs["understood"] == "'p' is taken in Pa, though the file says psig"

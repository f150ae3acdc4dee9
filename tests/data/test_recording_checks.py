"""What `read` and `from_arrays` refuse, and what they make of what they accept."""

import numpy as np
import pytest

from backsight import schema
from backsight.data import Column, from_arrays, read
from backsight.errors import DataError

T = np.arange(6) * 0.1
U = np.array([0.0, 1.0, 2.0, 3.0, 4.0, 5.0])
Y = U**2


def arrays(**changed):
    given = {"u": U, "y": Y, "time": T, "inputs": {"F": "N"}, "outputs": {"q": "m"}}
    return from_arrays(**{**given, **changed})


def with_value(values, k, value):
    changed = values.copy()
    changed[k] = value
    return changed


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "stage.csv"
    np.savetxt(path, np.c_[T, U, Y, 2 * Y], delimiter=",", header="t,u,y,v", comments="")
    return path


def test_a_recording_is_what_the_schema_makes():
    expected = schema.recording(T, u=U, y=Y, inputs={"F": "N"}, outputs={"q": "m"}, dt=0.1)
    made = arrays(dt=0.1)
    assert made.identical(expected)
    assert arrays().attrs["dt"] == pytest.approx(0.1, rel=1e-14)
    assert arrays(dt=0.1005).attrs["dt"] == 0.1005


def test_file_and_arrays_agree(path):
    columns = {"inputs": {"F": Column("u", unit="N")}, "outputs": {"q": {"name": "y", "unit": "m"}}}
    assert read(path, time="t", dt=0.1, **columns).identical(arrays(dt=0.1))


def test_several_signals_and_none():
    r = arrays(u=None, inputs={}, y=np.c_[Y, U], outputs={"a": "m", "b": "N"}, time=None, dt=0.1)
    assert dict(r.sizes) == {"time": 6, "input": 0, "output": 2}
    np.testing.assert_allclose(r.time, T, atol=1e-15)


def test_columns_become_physical(path):
    r = read(
        path,
        inputs={"F": Column("u", unit="N", factor=10.0, offset=1.0)},
        outputs={"q": Column("y", remove_mean=True)},
        time=Column("t", factor=1e-3),
        truth={"q": "y", "v": {"name": "v", "unit": "m/s"}},
        start=0.00015,
        stop=0.00045,
    )
    np.testing.assert_allclose(r.time, [2e-4, 3e-4, 4e-4])
    np.testing.assert_allclose(r.u[:, 0], [21, 31, 41])
    np.testing.assert_allclose(r.y[:, 0], np.array([4, 9, 16]) - 29 / 3)
    np.testing.assert_allclose(r.x_true, [[4, 8], [9, 18], [16, 32]])
    assert r.state.values.tolist() == ["q", "v"]
    assert r.state_unit.values.tolist() == ["", "m/s"]
    assert r.attrs["dt"] == pytest.approx(1e-4)


def test_selection_is_half_open(path):
    halves = [
        read(path, inputs={}, outputs={"q": "y"}, dt=1.0, start=a, stop=b)
        for a, b in ((None, 2.0), (2.0, None))
    ]
    assert [h.time.values.tolist() for h in halves] == [[0, 1], [2, 3, 4, 5]]


def test_the_mean_leaves_out_what_was_not_measured():
    column = Column("y", remove_mean=True)
    np.testing.assert_array_equal(column.physical(np.array([1.0, np.nan, 3.0])), [-1, np.nan, 1])
    np.testing.assert_array_equal(column.physical(np.full(2, np.nan)), [np.nan, np.nan])


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"u": with_value(U, 3, np.nan)}, r"input 'F' is nan at sample 3 \(t = 0.3 s\), 1 times"),
        ({"u": with_value(U, 5, np.inf)}, r"input 'F' is inf at sample 5"),
        ({"y": with_value(Y, 2, -np.inf)}, r"output 'q' is -inf at sample 2 .* write NaN"),
        ({"time": with_value(T, 4, np.nan)}, "time is nan at sample 4"),
        ({"time": with_value(T, 4, T[3])}, "does not increase at sample 4: 0.3 s follows 0.3 s"),
        ({"time": with_value(T, 1, -1)}, "does not increase at sample 1"),
        (
            {"time": with_value(T, 5, 0.502)},
            r"irregular: samples 4 and 5 \(t = 0.4 s\) are 0.102 s apart, the others 0.1 s; "
            r".*interpolate with resample = 0.1.* on average they are 0.1004 s apart",
        ),
        ({"dt": 0.01}, "dt is 0.01 s, but by their time the samples are 0.1 s apart"),
        ({"dt": 0.102}, "dt is 0.102 s"),
        ({"dt": 0.0}, "dt is 0.0; it must be a positive"),
        ({"dt": np.nan}, "dt is nan; it must be a positive"),
        ({"dt": "fast"}, "dt is 'fast'; it must be a positive"),
        ({"resample": -1}, "resample is -1; it must be a positive"),
        ({"resample": 9.0}, "shorter than the sampling period of 9 s"),
        ({"time": None}, "give the column of time, or the sampling period dt"),
        ({"u": U[1:]}, "numbers of samples differ .* 'u' 5, 'y' 6, 'time' 6"),
        ({"u": U[:1], "y": Y[:1], "time": T[:1]}, "1 samples; at least 2"),
        ({"u": [], "y": [], "time": []}, "0 samples; at least 2"),
        ({"y": np.c_[Y, Y]}, r"y has the shape \(6, 2\).* 1 columns: q"),
        ({"u": None}, "u has the shape .* 1 columns: F"),
        ({"y": ["a"] * 6}, "y is not an array of real numbers"),
    ],
)
def test_bad_arrays_are_refused(changed, message):
    with pytest.raises(DataError, match=message):
        arrays(**changed)


def test_jitter_below_one_percent_is_accepted():
    jitter = 0.4e-3 * np.random.default_rng(1).uniform(-1, 1, 1000)
    time = np.arange(1000) * 0.1 + jitter
    r = arrays(u=time, y=time, time=time)
    assert r.attrs["dt"] == pytest.approx(0.1, rel=1e-4)
    np.testing.assert_array_equal(r.time, time)


def test_an_irregular_recording_is_resampled_on_demand():
    r = arrays(time=with_value(T, 2, 0.25), resample=0.05)
    np.testing.assert_allclose(r.time, np.arange(11) * 0.05)
    np.testing.assert_allclose(r.u[:6, 0], [0, 0.5, 1, 4 / 3, 5 / 3, 2])
    assert r.attrs["dt"] == 0.05


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"inputs": {"F": "uu"}}, "no column 'uu': did you mean 'u'"),
        ({"inputs": {"F": {"name": "u", "unti": "N"}}}, "input 'F' has no field 'unti': .*'unit'"),
        ({"inputs": {"F": {"unit": "N"}}}, "input 'F' has no field 'name'"),
        ({"outputs": {"q": 3}}, "output 'q': give a column name"),
        ({"outputs": {"q": {"name": 3}}}, "name in the file, not by 3"),
        ({"outputs": {"q": {"name": "y", "factor": np.nan}}}, "factor is nan, not a finite"),
        ({"inputs": {}, "outputs": {}}, "at least one column"),
        ({"time": None}, "give the column of time"),
        ({"start": 0.3, "stop": 0.4}, "fewer than 2 samples between start = 0.3 and stop = 0.4"),
        ({"start": 2.0}, "the recording goes from 0 to 0.5 s"),
    ],
)
def test_a_bad_mapping_is_refused(path, changed, message):
    given = {"inputs": {"F": "u"}, "outputs": {"q": "y"}, "time": "t", **changed}
    with pytest.raises(DataError, match=message):
        read(path, **given)


def test_samples_are_counted_from_the_beginning_of_the_file(tmp_path):
    path = tmp_path / "r.npz"
    np.savez(path, t=T, u=with_value(U, 4, np.nan), y=Y)
    with pytest.raises(DataError, match=r"at sample 4 \(t = 0.4 s\)"):
        read(path, inputs={"F": "u"}, outputs={"q": "y"}, time="t", start=0.2)
    kept = read(path, inputs={"F": "u"}, outputs={"q": "y"}, time="t", stop=0.35)
    assert kept.sizes["time"] == 4


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("stag.csv", "there is no file .*: did you mean 'stage.csv'"),
        ("nowhere/stage.csv", "there is no folder"),
        (".", "is a folder"),
        ("stage.qqqqqq", "kind '.qqqqqq' are not read: known: .bag, .csv"),
    ],
)
def test_a_file_that_is_not_there_or_not_known(path, name, message):
    (path.parent / "stage.qqqqqq").touch()
    with pytest.raises(DataError, match=message):
        read(path.parent / name, inputs={}, outputs={"q": "y"}, dt=0.1)


def test_options_of_text_files_are_refused_elsewhere(tmp_path):
    np.savez(tmp_path / "r.npz", y=Y)
    with pytest.raises(DataError, match="skip_lines is for text files"):
        read(tmp_path / "r.npz", inputs={}, outputs={"q": "y"}, dt=0.1, skip_lines=1)

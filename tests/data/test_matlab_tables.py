"""Tables, timetables and other objects in MATLAB files."""

import warnings

import numpy as np
import pandas as pd
import pytest

from backsight.data import list_columns, read
from backsight.errors import DataError

N = 40
T = np.arange(N) * 0.5e-3
A, B = np.sin(np.arange(N)), np.arange(N) * 2.0


@pytest.fixture(scope="module", params=["v7", "v7.3"])
def tables(request, tmp_path_factory):
    matio = pytest.importorskip("matio")
    from matio.utils import MatlabOpaque

    frame = pd.DataFrame({"a": A, "b": B}, index=pd.to_timedelta(np.arange(N) * 500, unit="us"))
    frame.index.name = "Time"
    dated = frame.set_axis(pd.date_range("2026-03-01", periods=N, freq="5ms"), axis=0)
    dated.index.name = "When"
    words = pd.DataFrame({"t": T, "a": A, "note": ["x"] * N})
    series = MatlabOpaque(properties={"Data_": A, "Time_": T}, classname="timeseries")
    path = tmp_path_factory.mktemp("tables") / "r.mat"
    everything = {"tt": frame, "td": dated, "tab": words, "ts": series, "plain": A}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        matio.save_to_mat(str(path), {**everything, "s": {"tt": frame}}, version=request.param)
    return path


def test_timetables_of_matlab_bring_their_time(tables):
    for name in ("tt/a", "s.tt.a"):
        r = read(tables, inputs={}, outputs={"y": name})
        np.testing.assert_allclose(r.time, T, atol=1e-12)
        np.testing.assert_array_equal(r.y[:, 0], A)
    with pytest.raises(DataError, match=r"by their time the samples are 0\.0005 s apart"):
        read(tables, inputs={}, outputs={"y": "tt/a"}, dt=0.1)
    r = read(tables, inputs={}, outputs={"y": "td/a"}, time="td/When")
    assert (r.attrs["begin"], r.attrs["dt"]) == ("2026-03-01T00:00:00", pytest.approx(5e-3))


def test_tables_and_other_objects_of_matlab(tables):
    r = read(tables, inputs={}, outputs={"y": "tab/a"}, time="tab/t")
    np.testing.assert_array_equal(r.y[:, 0], A)
    r = read(tables, inputs={}, outputs={"y": "plain"}, dt=0.5e-3)
    np.testing.assert_array_equal(r.y[:, 0], A)
    with pytest.raises(DataError, match="'tab/note' is not an array of real numbers"):
        read(tables, inputs={}, outputs={"y": "tab/note"}, dt=0.1)
    with pytest.raises(DataError, match=r"class 'timeseries'; there, s = struct\('t', ts.Time"):
        read(tables, inputs={}, outputs={"y": "ts.Data"}, dt=0.1)
    found = list_columns(tables)
    assert {"tt/a", "td/b", "tab/a", "plain", "s/tt/b"} <= {c.name for c in found.signals}
    assert found["ts"].remarks == ("a timeseries of MATLAB",)


def test_cells_and_arrays_of_structures_of_version_73_are_read(tmp_path):
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "run.mat"
    values = {"a": np.arange(9.0), "b": np.arange(9.0) ** 2}
    with h5py.File(path, "w", userblock_size=512) as file:
        file["t"] = 0.1 * np.arange(9.0)[None]
        for name, column in values.items():
            file[f"#refs#/{name}"] = column[None]
            file[f"#refs#/{name}"].attrs["MATLAB_class"] = np.bytes_("double")
        file["t"].attrs["MATLAB_class"] = np.bytes_("double")
        group = file.create_group("ch")
        group.attrs["MATLAB_class"] = np.bytes_("struct")
        for owner, name in ((file, "c"), (group, "values")):
            entries = owner.create_dataset(name, (2, 1), dtype=h5py.ref_dtype)
            entries[0, 0], entries[1, 0] = file["#refs#/a"].ref, file["#refs#/b"].ref
        file["c"].attrs["MATLAB_class"] = np.bytes_("cell")
    head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(116) + b"\0" * 8 + b"\0\2IM"
    path.write_bytes(head + path.read_bytes()[len(head) :])

    for column in ("c{2}", "c[1]", "ch(2).values", "ch[1]/values"):
        recording = read(path, time="t", inputs={}, outputs={"q": column})
        np.testing.assert_array_equal(recording.y.values.ravel(), values["b"])

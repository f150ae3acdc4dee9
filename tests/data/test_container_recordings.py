"""Files that hold named arrays: one recording written in every format reads the same."""

import h5py
import numpy as np
import pytest
import scipy.io
import xarray as xr

from backsight.data import read
from backsight.errors import DataError

RNG = np.random.default_rng(7)
T = np.arange(50) * 1e-3
U = RNG.standard_normal(50)
ACC = RNG.standard_normal((50, 3))


def write_npz(path):
    np.savez(path, t=T, u=U, acc=ACC)


def write_mat_5(path):
    scipy.io.savemat(path, {"t": T, "u": U[:, None], "acc": ACC})


def write_mat_73(path):
    """As MATLAB does: a 512-byte block before the HDF5 part, axes reversed, vectors as (1, n)."""
    with h5py.File(path, "w", userblock_size=512) as file:
        file["t"], file["u"], file["acc"] = T[None], U[None], ACC.T
        file["#refs#/a"] = np.zeros(3)
    text = b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM"
    with path.open("r+b") as file:
        file.write(text)


def write_hdf5(path):
    with h5py.File(path, "w") as file:
        file["t"], file["u"], file["acc"] = T, U, ACC


def write_netcdf(path, engine="h5netcdf"):
    signals = {"u": ("t", U), "acc": (("t", "sensor"), ACC)}
    xr.Dataset(signals, coords={"t": T}).to_netcdf(path, engine=engine)


def write_netcdf_3(path):
    write_netcdf(path, "scipy")


WRITERS = {
    "r.npz": write_npz,
    "r.mat": write_mat_5,
    "v73.mat": write_mat_73,
    "r.h5": write_hdf5,
    "r.HDF5": write_hdf5,
    "r.nc": write_netcdf,
    "v3.nc": write_netcdf_3,
}


@pytest.mark.parametrize("name", WRITERS)
def test_every_format_gives_the_same_recording(tmp_path, name):
    WRITERS[name](tmp_path / name)
    r = read(tmp_path / name, inputs={"F": "u"}, outputs={"a": "acc[2]"}, time="t")
    np.testing.assert_array_equal(r.time, T)
    np.testing.assert_array_equal(r.u[:, 0], U)
    np.testing.assert_array_equal(r.y[:, 0], ACC[:, 2])


def write_tree_mat(path):
    scipy.io.savemat(path, {"log": {"drive": {"u": U}, "acc": ACC}})


def write_tree_hdf5(path):
    with h5py.File(path, "w") as file:
        file["log/drive/u"], file["log/acc"] = U, ACC


def write_tree_netcdf(path):
    acc = xr.Dataset({"acc": (("n", "sensor"), ACC)})
    acc.to_netcdf(path, group="log", engine="h5netcdf")
    u = xr.Dataset({"u": ("n", U)})
    u.to_netcdf(path, group="log/drive", engine="h5netcdf", mode="a")


@pytest.mark.parametrize(
    ("name", "write"),
    [("r.mat", write_tree_mat), ("r.h5", write_tree_hdf5), ("r.nc", write_tree_netcdf)],
)
def test_structures_and_groups_are_addressed_by_path(tmp_path, name, write):
    write(tmp_path / name)
    r = read(tmp_path / name, inputs={"F": "log/drive/u"}, outputs={"a": "log/acc[0]"}, dt=1e-3)
    np.testing.assert_array_equal(r.u[:, 0], U)
    np.testing.assert_array_equal(r.y[:, 0], ACC[:, 0])


@pytest.mark.parametrize(
    ("column", "message"),
    [
        ("acc", r"50 samples and 3 columns: take one as 'acc\[0\]' to 'acc\[2\]'"),
        ("acc[3]", r"'acc\[3\]' does not exist: 'acc' has the shape \(50, 3\)"),
        ("t[0]", r"'t\[0\]' does not exist: 't' has the shape \(50,\)"),
        ("ac[0]", "no column 'ac': did you mean 'acc'"),
        ("label", "not an array of real numbers"),
        ("modes", "not an array of real numbers, but of complex128"),
        ("cube", r"has the shape \(50, 2, 2\); a signal needs one axis"),
        ("short", "samples differ .* 'u' 50, 'short' 49"),
        ("one", "samples differ"),
        ("objects", "cannot be read as a '.npz' file"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, column, message):
    path = tmp_path / "r.npz"
    more = {"label": np.array(["a", "b"]), "modes": 1j * U, "cube": np.zeros((50, 2, 2))}
    objects = np.array([None, {}], object)
    np.savez(path, t=T, u=U, acc=ACC, short=U[1:], one=3.0, objects=objects, **more)
    with pytest.raises(DataError, match=message) as caught:
        read(path, inputs={"F": "u"}, outputs={"a": column}, time="t")
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize("size", [0, 100, 600])
def test_a_file_that_is_cut_off_is_one_clear_line(tmp_path, name, size):
    path = tmp_path / name
    WRITERS[name](path)
    path.write_bytes(path.read_bytes()[:size])
    with pytest.raises(DataError, match=r"cannot be read as a|no column") as caught:
        read(path, inputs={"F": "u"}, outputs={"a": "acc[2]"}, time="t")
    assert "\n" not in str(caught.value)

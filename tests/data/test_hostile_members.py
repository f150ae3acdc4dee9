"""Members of archives and MATLAB files from elsewhere, and names that no file can have."""

import io
import os
import pickle
import struct
import zipfile
import zlib

import numpy as np
import pytest
import scipy.io
import xarray as xr

from backsight.data import _room as room
from backsight.data import read
from backsight.errors import DataError

N = 50
T, U = np.arange(N) * 0.1, np.ones(N)
SECRET = b"password = hunter2; this is somebody's file and no recording at all......."


def signals(path, **more):
    return read(path, inputs={"u": "u"}, outputs={"y": "y"}, time="t", **more)


class Program:
    """Runs when it is unpickled."""

    def __init__(self, mark):
        self.mark = mark

    def __reduce__(self):
        return os.mkdir, (str(self.mark),)


def test_no_program_in_a_file_is_run(tmp_path):
    mark = tmp_path / "ran"
    evil = np.array([Program(mark)], dtype=object)
    np.savez(tmp_path / "member.npz", t=T, u=U, y=evil)
    np.save(tmp_path / "alone.npy", evil, allow_pickle=True)
    (tmp_path / "alone.npy").rename(tmp_path / "alone.npz")
    for name in ("pickle.npz", "pickle.mat", "pickle.h5", "pickle.nc"):
        (tmp_path / name).write_bytes(pickle.dumps(Program(mark)))
    for path in [p for p in tmp_path.iterdir() if p.is_file()]:
        with pytest.raises(DataError):
            signals(path)
    assert not mark.exists()


def member(folder, head, body=b""):
    """An archive whose member y has this head."""
    path = folder / "a.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, values in (("t", T), ("u", U)):
            content = io.BytesIO()
            np.save(content, values)
            archive.writestr(f"{name}.npy", content.getvalue())
        text = head.encode() + b" " * (64 - (11 + len(head)) % 64) + b"\n"
        size = len(text).to_bytes(2, "little")
        archive.writestr("y.npy", b"\x93NUMPY\x01\x00" + size + text + body)
    return path


@pytest.mark.parametrize("shape", ["(1000000000000,)", f"({10**30},)", "(-5,)", "('a',)", "5"])
@pytest.mark.parametrize("kind", ["<f8", "|O", "V0", "<U0", "nonsense"])
def test_a_member_that_claims_too_much_is_refused(tmp_path, shape, kind):
    head = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}"
    with pytest.raises(DataError):
        signals(member(tmp_path, head))


@pytest.mark.parametrize("head", ["__import__('os').mkdir('x')", "(" * 4000, "[" * 400, "{}", ""])
def test_a_head_that_is_none_is_refused(tmp_path, head):
    with pytest.raises(DataError, match="cannot be read"):
        signals(member(tmp_path, head))


def test_a_zip_bomb_is_refused_by_what_it_claims(tmp_path, monkeypatch):
    head = "{'descr': '<f8', 'fortran_order': False, 'shape': (10000000,), }"
    path = member(tmp_path, head, bytes(80_000_000))
    assert path.stat().st_size < 100_000
    monkeypatch.setattr(room, "_available", lambda: 200_000_000)
    with pytest.raises(DataError, match="'y' claims 80 MB, for which 320 MB"):
        signals(path)


def mat_5(folder, variable):
    path = folder / "a.mat"
    path.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + variable)
    return path


def test_a_mat_file_that_claims_too_much_is_refused(tmp_path):
    body = zlib.compress(struct.pack("<II", 14, 3_000_000_000) + bytes(10_000))
    with pytest.raises(DataError, match="claims 3 GB, but the file holds"):
        signals(mat_5(tmp_path, struct.pack("<II", 15, len(body)) + body))


@pytest.mark.parametrize("variable", [b"", b"\x0e", b"\x0f\0\0\0\xff\xff\xff\xff", b"\xff" * 999])
def test_a_mat_file_of_nonsense_is_refused(tmp_path, variable):
    with pytest.raises(DataError):
        signals(mat_5(tmp_path, variable))


def test_only_the_variables_that_are_wanted_are_read(tmp_path, monkeypatch):
    path = tmp_path / "a.mat"
    scipy.io.savemat(path, {"t": T, "u": U, "y": U, "more": np.array(["a", {}], dtype=object)})
    loaded = []
    load = scipy.io.loadmat
    monkeypatch.setattr(
        scipy.io, "loadmat", lambda *a, **k: loaded.append(load(*a, **k)) or loaded[-1]
    )
    signals(path)
    assert {k for k in loaded[0] if not k.startswith("__")} == {"t", "u", "y"}
    with pytest.raises(DataError, match="did you mean 'more'"):
        read(path, inputs={}, outputs={"y": "mor"}, time="t")


def test_a_coordinate_of_a_netcdf_file_that_is_not_wanted_is_not_read(tmp_path):
    path = tmp_path / "a.nc"
    times = {"t": ("k", T), "u": ("k", U), "y": ("k", U)}
    xr.Dataset(times, coords={"k": np.arange(N)}).to_netcdf(path, engine="h5netcdf")
    assert signals(path).sizes["time"] == N


@pytest.mark.parametrize("name", ["/dev/zero", "/dev/stdin", "/dev/tty"])
@pytest.mark.skipif(os.name == "nt", reason="devices are files on POSIX")
def test_a_device_is_no_recording(tmp_path, name):
    for kind in (".csv", ".h5", ".npz"):
        path = tmp_path / f"a{kind}"
        path.unlink(missing_ok=True)
        path.symlink_to(name)
        with pytest.raises(DataError, match=r"a device or a pipe|no file|cannot read"):
            signals(path)


@pytest.mark.parametrize("name", ["x" * 5000 + ".csv", "a\0.csv", "a/" * 3000 + "b.csv", ""])
def test_a_name_that_no_file_can_have_is_one_line(tmp_path, name):
    with pytest.raises(DataError) as caught:
        signals(f"{tmp_path}/{name}")
    assert len(str(caught.value)) <= 2000
    assert "\n" not in str(caught.value)

"""Matrices, modes and tables as finite-element programs and modal tests write them."""

import gzip
import io
import lzma
import struct

import h5py
import numpy as np
import pytest
import scipy.io
import scipy.sparse as sparse

from backsight.data import read_matrix
from backsight.errors import DataError

K = np.array(
    [
        [4123.25, -1050.5, 0.0, 25.125],
        [-1050.5, 2100.75, -1050.25, 0.0],
        [0.0, -1050.25, 2000.5, -949.75],
        [25.125, 0.0, -949.75, 950.0625],
    ]
)
M = np.diag([2.0, 1.0, 1.0, 0.5])
PLACES = ((3, 1), (3, 6), (12, 1), (12, 6))
NAMES = ("3:UX", "3:RZ", "12:UX", "12:RZ")
LOWER = [(i, j) for i in range(4) for j in range(i + 1) if K[i, j]]


def mat73(path, values):
    """A sparse matrix as MATLAB writes it in version 7.3."""
    A = sparse.csc_array(values)
    with h5py.File(path, "w", userblock_size=512) as file:
        group = file.create_group("K")
        group.attrs["MATLAB_sparse"] = np.uint64(A.shape[0])
        group["data"], group["ir"], group["jc"] = A.data, A.indices, A.indptr
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(512, b"\0"))


def abaqus(path, values):
    rows = [
        f"{PLACES[i][0]},{PLACES[i][1]}, {PLACES[j][0]},{PLACES[j][1]}, {values[i, j]: .14E}"
        for i, j in LOWER
    ]
    path.write_text("**\n** STIFFNESS MATRIX\n" + "\n".join(rows) + "\n")


def dmig_large(path, values):
    """A punch file: fields of 16 characters, D for E, the lower triangle."""
    lines = [f"$TITLE\n{'DMIG':8}{'KAAX':8}{0:8}{6:8}{2:8}{0:8}{'':16}{4:8}"]
    for j, (node, direction) in enumerate(PLACES):
        lines.append(f"{'DMIG*':8}{'KAAX':16}{node:16}{direction:16}")
        lines += [
            f"{'*':8}{PLACES[i][0]:16}{PLACES[i][1]:16}{values[i, j]:16.9E}".replace("E+", "D+")
            for i in range(j, 4)
            if values[i, j]
        ]
    path.write_text("\n".join(lines) + "\n")


def dmig_small(path, values):
    """Fields of 8, exponents without E, two entries a line; a second matrix behind."""
    lines = ["BEGIN BULK", f"{'DMIG':8}{'KAAX':8}{0:8}{1:8}{1:8}{0:8}"]
    for j, (node, direction) in enumerate(PLACES):
        line, many = f"{'DMIG':8}{'KAAX':8}{node:8}{direction:8}{'':8}", 1
        for i in np.flatnonzero(values[:, j]):
            text = f"{values[i, j] / 1000:.6f}"[:6] + "+3"
            if many == 2:
                lines.append(line)
                line, many = " " * 8, 0
            line += f"{PLACES[i][0]:8}{PLACES[i][1]:8}{text:>8}{'':8}"
            many += 1
        lines.append(line.rstrip())
    lines += ["GRID,3,,0.,0.,0.", "DMIG,MAAX,0,6,2,0,,,4", "DMIG,MAAX,3,1,,3,1,2.0"]
    path.write_text("\n".join(lines) + "\nENDDATA\n")


def op4_text(path, values, *, sparse_rows):
    """Both forms of text; of the sparse one, strings with length and row in words of their own."""
    n = len(values)
    lines = [f"{n:8}{-n if sparse_rows else n:8}{6:8}{2:8}{'KAAX':8}1P,3E23.16"]
    for j in range(n):
        rows = np.flatnonzero(values[:, j])
        first, last = rows[0], rows[-1]
        part = values[first : last + 1, j]
        numbers = [f"{v:23.16E}" for v in part]
        text = ["".join(numbers[k : k + 3]) for k in range(0, len(numbers), 3)]
        if sparse_rows:
            size = 2 * part.size
            lines += [f"{j + 1:8}{0:8}{size + 2:8}", f"{size + 1:8}{first + 1:8}", *text]
        else:
            lines += [f"{j + 1:8}{first + 1:8}{2 * part.size:8}", *text]
    lines += [f"{n + 1:8}{1:8}{1:8}", f"{1.0:23.16E}"]
    path.write_text("\n".join(lines) + "\n")


def op4_binary(path, values, *, packed):
    """Records of Fortran; full columns, or strings with length and row in one word."""
    n = len(values)

    def record(data):
        return struct.pack("<i", len(data)) + data + struct.pack("<i", len(data))

    content = record(struct.pack("<4i8s", n, n, 6, 2, b"KAAX    "))
    for j in range(n):
        column = values[:, j].astype("<f8").tobytes()
        if packed:
            head = struct.pack("<3ii", j + 1, 0, 2 * n + 1, 1 + 65536 * (2 * n + 1))
        else:
            head = struct.pack("<3i", j + 1, 1, 2 * n)
        content += record(head + column)
    content += record(struct.pack("<3id", n + 1, 1, 2, 1.0))
    path.write_bytes(content)


def boeing_symmetric(path):
    """The lower triangle, and a head that says so."""
    scipy.io.hb_write(path, sparse.csc_matrix(np.tril(K)))
    path.write_text(path.read_text().replace("RUA", "RSA"))


def table(path, values):
    rows = "\n".join(",".join(map(repr, row)) for row in values.tolist())
    path.write_text("# from a spreadsheet\n" + ",".join(NAMES) + "\n" + rows)


def market(path, change=lambda text: text):
    """A symmetric Matrix Market file, its text changed."""
    text = io.BytesIO()
    scipy.io.mmwrite(text, sparse.coo_array(K), symmetry="symmetric")
    path.write_bytes(change(text.getvalue()))


def without_head(text):
    """Of a general file: the line of sizes comes first."""
    return b"\n".join(line for line in text.splitlines() if not line.startswith(b"%"))


WRITERS = {
    "marked.mtx": lambda p: market(p, lambda text: b"\xef\xbb\xbf" + text),
    "wide.mtx": lambda p: market(p, lambda text: text.decode().encode("utf-16")),
    "small.mtx": lambda p: market(
        p, lambda text: text.replace(b"%%MatrixMarket", b"%%matrixmarket")
    ),
    "packed.mtx.gz": lambda p: market(p, gzip.compress),
    "packed.mtx.xz": lambda p: market(p, lzma.compress),
    "bare.txt": lambda p: (
        scipy.io.mmwrite(p.with_suffix(".mtx"), sparse.coo_array(K), symmetry="general"),
        p.write_bytes(without_head(p.with_suffix(".mtx").read_bytes())),
    ),
    "market.mtx": lambda p: scipy.io.mmwrite(p, sparse.coo_array(K)),
    "symmetric.mtx": lambda p: scipy.io.mmwrite(p, sparse.coo_array(K), symmetry="symmetric"),
    "full.mtx": lambda p: scipy.io.mmwrite(p, K),
    "five.mat": lambda p: scipy.io.savemat(p, {"K": sparse.csc_matrix(K), "b": np.ones((4, 1))}),
    "structure.mat": lambda p: scipy.io.savemat(p, {"K": K}),
    "seven.mat": lambda p: mat73(p, K),
    "scipy.npz": lambda p: sparse.save_npz(p, sparse.csr_array(K)),
    "numpy.npz": lambda p: np.savez(p, K=K),
    "numpy.npy": lambda p: np.save(p, K),
    "boeing.rua": lambda p: scipy.io.hb_write(p, sparse.csc_matrix(K)),
    "boeing.rsa": boeing_symmetric,
    "opensees.out": lambda p: np.savetxt(p, K),
    "triplets.txt": lambda p: p.write_text(
        "\n".join(
            f"{i + 1} {j + 1} {float(K[i, j])!r}" for i in range(4) for j in range(4) if K[i, j]
        )
    ),
    "table.csv": lambda p: table(p, K),
    "job_STIF1.mtx": lambda p: abaqus(p, K),
    "large.pch": lambda p: dmig_large(p, K),
    "text.op4": lambda p: op4_text(p, K, sparse_rows=False),
    "sparse.op4": lambda p: op4_text(p, K, sparse_rows=True),
    "binary.op4": lambda p: op4_binary(p, K, packed=False),
    "packed.op4": lambda p: op4_binary(p, K, packed=True),
}
NAMED = {"table.csv", "job_STIF1.mtx", "large.pch"}


@pytest.mark.parametrize("kind", WRITERS)
def test_matrices_of_any_program(kind, tmp_path):
    path = tmp_path / kind
    WRITERS[kind](path)
    found = read_matrix(path)
    assert sparse.issparse(found.values)
    np.testing.assert_allclose(found.toarray(), K, rtol=1e-9)
    assert found.coordinates == (NAMES if kind in NAMED else ())


def test_a_head_that_says_skew(tmp_path):
    G = np.array([[0.0, -3.0, 0.0], [3.0, 0.0, 2.0], [0.0, -2.0, 0.0]])
    scipy.io.mmwrite(tmp_path / "g.mtx", sparse.coo_array(G), symmetry="skew-symmetric")
    scipy.io.hb_write(tmp_path / "g.rza", sparse.csc_matrix(np.tril(G)))
    whole = (tmp_path / "g.rza").read_text()
    (tmp_path / "g.rza").write_text(whole.replace("RUA", "rza"))
    for name in ("g.mtx", "g.rza"):
        np.testing.assert_array_equal(read_matrix(tmp_path / name).toarray(), G)


def test_both_triangles_under_a_head_that_says_one_are_refused(tmp_path):
    scipy.io.mmwrite(tmp_path / "k.mtx", sparse.coo_array(K), symmetry="general")
    scipy.io.hb_write(tmp_path / "k.rsa", sparse.csc_matrix(K))
    for name, says, instead in (("k.mtx", "general", "symmetric"), ("k.rsa", "RUA", "RSA")):
        path = tmp_path / name
        path.write_text(path.read_text().replace(says, instead, 1))
        with pytest.raises(
            DataError, match=rf"{name}: its head says '{instead}', that one triangle"
        ):
            read_matrix(path)


def test_one_of_several(tmp_path):
    path = tmp_path / "model.mat"
    scipy.io.savemat(path, {"K": sparse.csc_matrix(K), "M": M, "fe": {"K": sparse.csc_matrix(K)}})
    np.testing.assert_array_equal(read_matrix(path, name="M").toarray(), M)
    np.testing.assert_array_equal(read_matrix(path, name="fe/K").toarray(), K)
    with pytest.raises(DataError, match="has the matrices K, M; say which by name"):
        read_matrix(path)
    with pytest.raises(DataError, match="has no matrix 'C': "):
        read_matrix(path, name="C")


def test_dmig_in_small_fields(tmp_path):
    path = tmp_path / "model.bdf"
    dmig_small(path, K)
    found = read_matrix(path, name="KAAX")
    np.testing.assert_allclose(found.toarray(), K, rtol=2e-3)
    assert found.coordinates == NAMES
    mass = read_matrix(path, name="MAAX")
    assert (mass.coordinates, mass.toarray().item()) == (("3:UX",), 2.0)


def test_digits_tell_the_rounding(tmp_path):
    path = tmp_path / "k.mtx"
    scipy.io.mmwrite(path, sparse.coo_array(K / 3), precision=7)
    assert read_matrix(path).precision == pytest.approx(5e-7)
    np.savetxt(tmp_path / "exact.txt", np.array([[2, -1], [-1, 2]]), fmt="%d")
    assert read_matrix(tmp_path / "exact.txt").precision < 1e-15


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.txt", "", "is empty"),
        ("a.txt", "1 2\n3", r"the rows have different lengths: \[1, 2\]"),
        ("a.txt", "1 2\n3 x", "'x' is not a number"),
        ("a.mtx", "1,1,1,1,2.0\n1,1,1\n", "entry 2: '1,1,1' is not node, direction"),
        ("a.pch", "DMIG    KAAX           1       1\n", "has 0 header entries"),
        ("a.pch", "DMIG,KAAX,0,9,2,0,,,4\n", "is of the form 9, not square"),
        ("a.pch", "DMIG,KAAX,0,6,3,0,,,4\n", "is complex"),
        ("a.pch", "DMIG,KAAX,0,6,1,0\nDMIG,KAAX,1,1,,1,1,two\n", "'TWO' is not a number|'two' is"),
        ("a.mtx", "%%MatrixMarket matrix coordinate pattern general\n1 1 1\n1 1\n", "a pattern"),
        ("a.mtx", "%%MatrixMarket matrix array complex general\n1 1\n1 1\n", "a complex matrix"),
        ("a.bin", "\0\1\2\3" * 20, "binary file of an unknown kind"),
    ],
)
def test_what_is_no_matrix_is_said(name, content, message, tmp_path):
    path = tmp_path / name
    path.write_text(content)
    with pytest.raises(DataError, match=message):
        read_matrix(path)


def test_files_that_are_cut_off(tmp_path):
    for kind in ("binary.op4", "sparse.op4", "market.mtx", "five.mat", "scipy.npz"):
        path = tmp_path / kind
        WRITERS[kind](path)
        path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])
        with pytest.raises(DataError, match=kind):
            read_matrix(path)
    with pytest.raises(DataError, match="there is no file"):
        read_matrix(tmp_path / "none.mtx")


def test_numbers_that_happen_to_be_short_are_exact(tmp_path):
    """Entries of an even mesh with round properties: no rounding that could hide a mode."""
    path = tmp_path / "short.mtx"
    round_ones = np.array(
        [[8.064e7, -2.016e7, 0], [-2.016e7, 1.6128e8, 6.72e6], [0, 6.72e6, 3.36e6]]
    )
    for written in ({}, {"precision": 9}):
        scipy.io.mmwrite(path, sparse.coo_array(round_ones), **written)
        assert read_matrix(path).precision < 1e-15
    scipy.io.mmwrite(path, sparse.coo_array(round_ones / 11), precision=9)
    assert read_matrix(path).precision == pytest.approx(5e-9)

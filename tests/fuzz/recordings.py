"""Recordings in every format that is read, damaged."""

import contextlib
import random
from collections.abc import Callable
from pathlib import Path

import numpy as np
from tests.data import test_benches, test_container_recordings, test_formats, test_robots
from tests.fuzz.isolated import Area
from tests.fuzz.mutating import mutated_bytes, mutated_text

import backsight as bs
from backsight.errors import BacksightError

TEXT = "time [ms];force [N];place [µm]\n" + "".join(
    f"{2 * k};{k % 3 - 1},5;{k % 7 * 0.25:.2f}\n".replace(".", ",") for k in range(40)
)

DATES = "when,force,place\n" + "".join(
    f"2026-03-01 10:00:{k // 10:02d}.{k % 10},{k % 3},{k % 7 * 0.5}\n" for k in range(40)
)


def frame(path: Path) -> None:
    """A table of pandas, in the format of the suffix."""
    import pandas as pd

    table = pd.DataFrame({"t": np.arange(40) * 0.1, "a": np.sin(np.arange(40)), "b": 1.0})
    match path.suffix:
        case ".parquet":
            table.to_parquet(path)
        case ".feather":
            table.to_feather(path)
        case _:
            table.to_excel(path, index=False)


def sound(path: Path) -> None:
    import scipy.io.wavfile

    scipy.io.wavfile.write(path, 2000, np.c_[np.arange(40), -np.arange(40)].astype(np.int16))


def bag(path: Path) -> None:
    """The file inside a bag of ROS 2."""
    folder = path.with_name(f"{path.name} folder")
    kind = {".mcap": "MCAP", ".db3": "SQLITE3"}[path.suffix]
    test_robots.write_bag(folder, kind)
    (inside,) = (p for p in folder.iterdir() if p.suffix == path.suffix)
    inside.rename(path)


def text(content: str) -> Callable[[Path], object]:
    return lambda path: path.write_text(content, encoding="utf-8")


WRITERS: dict[str, Callable[[Path], object]] = {
    "a.csv": text(TEXT),
    "b.csv": text(DATES),
    **test_formats.WRITERS,
    "r.mf4": test_benches.write_mdf,
    "r.sel": test_benches.write_hawc2_binary,
    "r.npz": test_container_recordings.write_npz,
    "5.mat": test_container_recordings.write_mat_5,
    "73.mat": test_container_recordings.write_mat_73,
    "r.h5": test_container_recordings.write_hdf5,
    "r.nc": test_container_recordings.write_netcdf,
    "3.nc": test_container_recordings.write_netcdf_3,
    "r.parquet": frame,
    "r.feather": frame,
    "r.xlsx": frame,
    "r.wav": sound,
    "r.mcap": bag,
    "r.db3": bag,
}


def area(folder: Path) -> Area:
    """Files; the first byte says which format."""
    names = sorted(WRITERS)
    right = []
    for name in names:
        WRITERS[name](folder / name)
        right.append((folder / name).read_bytes())

    def make(draw: random.Random) -> bytes:
        k = draw.randrange(len(names))
        if names[k].endswith(".csv") and draw.random() < 0.7:
            changed = mutated_text(right[k].decode(), draw).encode("utf-8", "surrogatepass")
        else:
            changed = mutated_bytes(right[k], draw)
        return bytes([k]) + changed

    def attempt(case: bytes) -> None:
        path = folder / f"case_{names[case[0]]}"
        path.write_bytes(case[1:])
        found = bs.data.list_columns(path)
        signals = [c.name for c in found.signals][:3]
        if signals:
            asked = {f"s{k}": name for k, name in enumerate(signals)}
            with contextlib.suppress(BacksightError):
                bs.read(path, inputs={}, outputs=asked)
            clock = getattr(found.clock, "name", None)
            bs.read(path, inputs={}, outputs=asked, time=clock, resample=0.01)

    return Area("recordings", make, attempt)

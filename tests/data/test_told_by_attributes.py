"""What arrays say of themselves: units, dates, factors, masks; in files and in memory."""

import wave
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd
import pytest
import xarray as xr

import backsight as bs
from backsight.errors import DataError

N, DT = 12, 0.01
TIMES = DT * np.arange(N)
POSITIONS = np.round(np.cos(0.3 * np.arange(N)), 4)
DATES = np.datetime64("2024-03-01", "ns") + (np.arange(N) * 10**7).astype("m8[ns]")


def checked(recording: xr.Dataset, positions: np.ndarray = POSITIONS) -> xr.Dataset:
    np.testing.assert_allclose(recording.time, TIMES, rtol=0, atol=2e-9)  # dates have ns
    np.testing.assert_allclose(recording.y.values.ravel(), positions, rtol=1e-12)
    return recording


@pytest.mark.parametrize("engine", ["scipy", "h5netcdf"])
@pytest.mark.parametrize("unit", ["ms", "milliseconds since 2024-03-01", "hours since 2024-03-01"])
def test_time_of_netcdf_counts_in_its_own_unit(tmp_path, engine, unit):
    count = {"ms": 1e3, "mi": 1e3, "ho": 1 / 3600}[unit[:2]]
    table = xr.Dataset(
        {"q": ("time", POSITIONS, {"units": "mm"})},
        coords={"time": ("time", TIMES * count, {"units": unit})},
    )
    table.to_netcdf(tmp_path / "run.nc", engine=engine)
    ask = {"time": "time", "inputs": {}, "outputs": {"q": {"name": "q", "unit": "m"}}}

    recording = checked(bs.read(tmp_path / "run.nc", **ask), 1e-3 * POSITIONS)
    found = bs.data.list_columns(tmp_path / "run.nc")

    assert recording.attrs.get("begin", "") == ("" if unit == "ms" else "2024-03-01T00:00:00")
    assert found.clock == "time"
    assert found.dt == pytest.approx(DT)
    assert found["q"].unit == "mm"


def test_dates_as_xarray_writes_them_are_dates(tmp_path):
    xr.Dataset({"q": ("time", POSITIONS)}, coords={"time": DATES}).to_netcdf(
        tmp_path / "run.nc", engine="h5netcdf"
    )
    checked(bs.read(tmp_path / "run.nc", time="time", inputs={}, outputs={"q": "q"}))


def test_numbers_in_hdf5_that_are_stored_as_others_are_unpacked_and_it_is_said(tmp_path):
    path = tmp_path / "run.h5"
    with h5py.File(path, "w") as file:
        file["t"] = 1e3 * TIMES
        file["t"].attrs["units"] = "ms"
        file["q"] = np.r_[np.round(POSITIONS[:-1] * 1e4), -32768].astype(np.int16)
        file["q"].attrs.update({"scale_factor": 1e-4, "_FillValue": np.int16(-32768)})

    recording = bs.read(path, time="t", inputs={}, outputs={"q": "q"})

    checked(recording, np.r_[POSITIONS[:-1], np.nan])
    assert recording.attrs["understood"] == "'q' unpacked as the attributes say"


def test_tables_of_pandas_and_of_numpy_are_read_by_column(tmp_path):
    rows = np.zeros(N, [("index", "i8"), ("values_block_0", "f8", (2,))])
    rows["values_block_0"] = np.c_[TIMES, POSITIONS]
    with h5py.File(tmp_path / "run.h5", "w") as file:
        file["run/table"] = rows
    np.savez(tmp_path / "run.npz", run=rows, when=DATES)
    q = "values_block_0[1]"

    checked(
        bs.read(
            tmp_path / "run.h5",
            time="run/table/values_block_0[0]",
            inputs={},
            outputs={"q": f"run/table/{q}"},
        )
    )
    checked(bs.read(tmp_path / "run.npz", time="when", inputs={}, outputs={"q": f"run/{q}"}))
    listed = bs.data.list_columns(tmp_path / "run.npz")
    assert f"run/{q}" in listed


def test_ticks_since_1970_stay_exact(tmp_path):
    path = tmp_path / "run.h5"
    with h5py.File(path, "w") as file:
        file["t"] = DATES.astype(np.int64)
        file["q"] = POSITIONS

    checked(bs.read(path, time="t", inputs={}, outputs={"q": "q"}))


@pytest.mark.parametrize("bits", [8, 16, 24, 32])
def test_sounds_are_counts_of_the_converter(tmp_path, bits):
    path = Path(tmp_path, "run.wav")
    counts = np.round(POSITIONS * (2 ** (bits - 1) - 2)).astype(int).tolist()
    with wave.open(str(path), "wb") as file:
        file.setparams((1, bits // 8, 100, N, "NONE", ""))
        for count in counts:
            shifted = count + 128 if bits == 8 else count
            file.writeframes(shifted.to_bytes(bits // 8, "little", signed=bits > 8))

    recording = bs.read(path, inputs={}, outputs={"q": "data[0]"})

    assert recording.y.values.ravel().tolist() == counts
    assert list(bs.data.list_columns(path)) == ["data[0]"]


def test_formulas_that_nobody_computed_are_refused(tmp_path):
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    for row in (["t", "q"], [0.0, 1.5], [0.01, "=2*B2"], [0.02, 2.5]):
        book.active.append(row)
    book.create_sheet("Notes").append(["hello"])
    book.save(tmp_path / "run.xlsx")

    with pytest.raises(DataError, match="cell B3 of 'Sheet' is a formula that was never computed"):
        bs.read(tmp_path / "run.xlsx", time="t", inputs={}, outputs={"q": "q"})


def test_another_sheet_is_proposed_and_text_cells_have_signs_of_their_own(tmp_path):
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    book.active.append(["hello"])
    sheet = book.create_sheet("Data")
    for row in (["t", "q"], ["0,00", "1,5"], ["0,01", "2,5"], ["0,02", "3,5"]):
        sheet.append(row)
    path = tmp_path / "run.xlsx"
    book.save(path)

    with pytest.raises(DataError, match="take another sheet as 'Data/"):
        bs.read(path, time="t", inputs={}, outputs={"q": "q"})
    recording = bs.read(path, time="Data/t", inputs={}, outputs={"q": "Data/q"})
    assert recording.y.values.ravel().tolist() == [1.5, 2.5, 3.5]


def test_the_index_of_a_frame_in_parquet_is_time_and_nulls_are_missing(tmp_path):
    pytest.importorskip("pyarrow")
    switch = pd.array([None, *([True, False] * N)[: N - 1]], dtype="boolean")
    frame = pd.DataFrame({"q": POSITIONS, "on": switch}, index=pd.DatetimeIndex(DATES))
    frame.to_parquet(tmp_path / "run.parquet")

    recording = bs.read(tmp_path / "run.parquet", inputs={}, outputs={"q": "q", "on": "on"})

    checked(recording.isel(output=[0]))
    assert recording.attrs["begin"] == "2024-03-01T00:00:00"
    assert recording.y.values[:3, 1].tolist()[1:] == [1.0, 0.0]
    assert np.isnan(recording.y.values[0, 1])


def test_mdf_of_version_3_says_its_units(tmp_path):
    asammdf = pytest.importorskip("asammdf")
    file = asammdf.MDF(version="3.30")
    file.append([asammdf.Signal(POSITIONS, TIMES, name="q", unit="mm")])
    file.save(tmp_path / "run.mdf", overwrite=True)
    file.close()

    recording = bs.read(tmp_path / "run.mdf", inputs={}, outputs={"q": {"name": "q", "unit": "m"}})

    checked(recording, 1e-3 * POSITIONS)


def test_what_is_in_memory_keeps_its_units_masks_and_times():
    labels = {"inputs": {}, "outputs": {"q": "mm"}}
    labelled = xr.Dataset(
        {"q": ("time", 1e-3 * POSITIONS, {"units": "m"})},
        coords={"time": ("time", 1e3 * TIMES, {"units": "ms"})},
    )
    pint = pytest.importorskip("pint").UnitRegistry()
    masked = np.ma.masked_array(POSITIONS, mask=np.arange(N) == 3)

    checked(bs.from_arrays(y=labelled, **labels))
    quantity = {"y": pint.Quantity(1e-3 * POSITIONS, "m"), "time": pint.Quantity(1e3 * TIMES, "ms")}
    checked(bs.from_arrays(**quantity, **labels))
    wrong: Any = np.timedelta64(10, "ms")
    gap = np.where(np.arange(N) == 3, np.nan, POSITIONS)
    checked(bs.from_arrays(y=masked, time=TIMES, **labels), gap)
    with pytest.raises(DataError, match=r"dt is .*; it must be a positive number of seconds"):
        bs.from_arrays(y=POSITIONS, dt=wrong, **labels)


def test_frames_of_polars_go_in_by_name_lazy_ones_too():
    polars = pytest.importorskip("polars")
    frame = polars.DataFrame({"F": 2 * POSITIONS, "q": POSITIONS, "t": DATES})

    for given in (frame, frame.lazy()):
        checked(bs.from_arrays(y=given, time="t", inputs={}, outputs={"q": "mm"}))

"""What is said of the columns of a file before it is read: clocks, units, and what looks wrong."""

import numpy as np
import pytest
import scipy.io
import scipy.sparse

from backsight.data import from_arrays, list_columns, read, to_grid
from backsight.errors import DataError
from backsight.problem.starting import write_start

N, DT = 400, 0.002
RNG = np.random.default_rng(5)
SINE = np.sin(0.05 * np.arange(N))
NOISY = SINE + 0.01 * RNG.standard_normal(N)


def write(path, columns, *, stop=N):
    rows = [",".join(columns)]
    cells = [[f"{v:.9g}" if v == v else "" for v in values] for values in columns.values()]
    rows += [",".join(row) for row in list(zip(*cells, strict=True))[:stop]]
    path.write_text("\n".join(rows) + "\n")
    return path


def listed(tmp_path, **columns):
    return list_columns(write(tmp_path / "run.csv", {"t": DT * np.arange(N), **columns}))


def test_a_sound_file_has_a_clock_and_no_remarks(tmp_path):
    path = write(tmp_path / "run.csv", {"t [ms]": 2.0 * np.arange(N), "acc [m/s^2]": NOISY})
    found = list_columns(path)
    assert (found.clock, found.factor, found.even, found.sure) == ("t", 1e-3, True, True)
    assert found.dt == pytest.approx(DT)
    (column,) = found.signals
    assert (column.name, column.unit, column.missing, column.remarks) == ("acc", "m/s^2", 0, ())
    assert column.rate == pytest.approx(1 / DT)
    assert column.noise == pytest.approx(0.01, rel=0.2)
    assert (column.low, column.high) == pytest.approx((NOISY.min(), NOISY.max()), rel=1e-8)


def test_codes_clipping_dropouts_and_standstill_are_seen(tmp_path):
    coded, cut, lost, stuck = (NOISY.copy() for _ in range(4))
    coded[50:60] = -999
    lost[100:150] = np.nan
    stuck[200:280] = stuck[200]
    found = listed(
        tmp_path, coded=coded, cut=np.clip(cut, -0.8, 0.8), lost=lost, stuck=stuck, off=0 * cut
    )
    assert found.codes == (-999.0,)
    assert "missing = [-999]" in found["coded"].remarks[0]
    assert found["coded"].low == pytest.approx(coded[coded > -999].min(), rel=1e-8)
    assert [r.partition("?")[0] for r in found["cut"].remarks] == ["clipped", "clipped"]
    assert found["lost"].remarks == ("one gap of 0.1 s, from 0.2 s on",)
    assert found["lost"].missing == 50
    assert found["stuck"].remarks[0].startswith("stuck? 80 samples")
    assert found["off"].remarks == ("constant",)


def test_what_is_sound_is_left_alone(tmp_path):
    """Switches, quantised sines at their crests, held inputs, zeros at rest."""
    force = np.repeat(RNG.choice([-5.0, 5.0], N // 20), 20)
    found = listed(
        tmp_path, switch=1.0 * (SINE > 0), coarse=np.round(SINE, 2), force=force, fine=NOISY
    )
    assert [c.remarks for c in found.signals] == [()] * 4


def test_a_slow_channel_between_fast_ones_has_a_rate_of_its_own(tmp_path):
    slow = np.where(np.arange(N) % 10 == 0, NOISY, np.nan)
    found = listed(tmp_path, fast=NOISY, slow=slow)
    assert found["slow"].rate == pytest.approx(0.1 / DT)
    assert (found["slow"].missing, found["slow"].remarks) == (0, ())


def test_gaps_of_the_clock_are_told_and_a_grid_bridges_them_exactly(tmp_path):
    keep = np.r_[0:100, 160:N]
    path = write(
        tmp_path / "gap.csv",
        {"time": (DT * np.arange(N))[keep], "y": NOISY[keep]},
        stop=len(keep),
    )
    found = list_columns(path)
    assert not found.even
    assert found.dt == pytest.approx(DT)
    assert found.remarks == ("a gap of 0.122 s after 0.198 s",)
    with pytest.raises(DataError, match=r"grid = 0\.002 \(exact"):
        read(path, inputs={}, outputs={"y": "y"}, time="time")
    recording = read(path, inputs={}, outputs={"y": "y"}, time="time", grid=DT)
    there = np.full(N, np.nan)
    there[keep] = NOISY[keep]
    np.testing.assert_allclose(recording.y.values[:, 0], there, rtol=1e-8)
    assert recording.attrs["dt"] == DT


def test_a_grid_moves_no_sample_far_and_holds_inputs():
    time = np.array([0.0, 0.35, 0.6, 1.19])
    given = {"inputs": {"u": ""}, "outputs": {"y": ""}}
    u, y = [1.0, 2.0, 3.0, 4.0], [5.0, 6.0, 7.0, 8.0]
    with pytest.raises(DataError, match="would be moved by"):
        from_arrays(u=u, y=y, time=time, grid=0.3, **given)
    fine = from_arrays(u=u, y=y, time=time, grid=0.05, **given)
    assert fine.sizes["time"] == 25
    assert fine.u.values[:, 0].tolist() == [1.0] * 7 + [2.0] * 5 + [3.0] * 12 + [4.0]
    assert np.flatnonzero(np.isfinite(fine.y.values[:, 0])).tolist() == [0, 7, 12, 24]
    assert "moved by 0.01 s at most" in fine.attrs["understood"]
    with pytest.raises(DataError, match="not both"):
        from_arrays(u=u, y=y, time=time, grid=0.05, resample=0.1, **given)
    again = to_grid(fine, 0.05)
    np.testing.assert_array_equal(again.y.values, fine.y.values)


@pytest.mark.parametrize(
    ("head", "cells", "form"),
    [
        ("stamp", lambda k: f"{1.7e9 + DT * k:.3f}", "unix"),
        ("timestamp", lambda k: str(1_700_000_000_000 + 2 * k), "unix_ms"),
        ("Zeit", lambda k: f"27.03.2026 10:00:{k // 500:02d}.{2 * (k % 500):03d}", ""),
    ],
)
def test_clocks_of_every_kind(tmp_path, head, cells, form):
    path = tmp_path / "run.csv"
    rows = "".join(f"{cells(k)};{NOISY[k]:.5f}\n" for k in range(N))
    path.write_text(f"{head};y\n{rows}")
    found = list_columns(path)
    assert (found.clock, found.time_format, found.even) == (head, form, True)
    assert found.dt == pytest.approx(DT, rel=1e-6)
    assert [c.name for c in found.signals] == ["y"]
    recording = read(path, inputs={}, outputs={"y": "y"}, time=head, time_format=form or None)
    assert recording.attrs["dt"] == pytest.approx(found.dt, rel=1e-6)


def test_what_is_no_signal_is_listed_with_the_reason(tmp_path):
    path = tmp_path / "things.mat"
    scipy.io.savemat(
        path,
        {
            "acc": np.stack([NOISY, SINE, NOISY]),
            "square": np.eye(4),
            "fs": 500.0,
            "name": "run 1",
            "slow": scipy.sparse.csc_matrix(np.eye(1, N).T),
        },
    )
    found = list_columns(path)
    assert [c.name for c in found.signals] == ["acc[0]", "acc[1]", "acc[2]", "slow"]
    assert found.clock is None
    assert {n: c.remarks for n, c in found.items() if c.kind == "other"} == {
        "square": ("a matrix 4 x 4: say the axis of time",),
        "fs": ("one number",),
        "name": ("text",),
    }
    recording = read(path, inputs={}, outputs={"y": "slow"}, dt=DT)
    assert recording.y.values.ravel().tolist() == [1.0] + [0.0] * (N - 1)


def test_a_column_that_cannot_be_read_does_not_hide_the_others(tmp_path):
    path = tmp_path / "run.csv"
    rows = "".join(f"{DT * k:g},{NOISY[k]:.5f},{k if k != 70 else 'E7'}\n" for k in range(100))
    path.write_text("t,y,z\n" + rows)
    found = list_columns(path)
    assert [c.name for c in found.signals] == ["y"]
    assert found["z"].remarks == ("line 72, column 'z': 'E7' is not a number",)


def test_rows_without_time_and_values_at_the_ends_are_left_off(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("time,y\nNaT,NaN\n,\n0,1\n1,2\n2,3\n,\n")
    recording = read(path, inputs={}, outputs={"y": "y"}, time="time")
    assert recording.y.values.ravel().tolist() == [1.0, 2.0, 3.0]
    assert "3 rows without time and values left off" in recording.attrs["understood"]
    path.write_text("time,y\n,7\n0,1\n1,2\n")
    with pytest.raises(DataError, match="every sample needs a time"):
        read(path, inputs={}, outputs={"y": "y"}, time="time")


def test_the_table_fits_the_page(tmp_path):
    text = str(listed(tmp_path, displacement_of_the_roof=NOISY, cut=np.clip(NOISY, -0.8, 0.8)))
    lines = text.splitlines()
    assert max(map(len, lines)) <= 80
    assert lines[0] == "run.csv: 400 rows; time 't', every 0.002 s (500 Hz)"
    head = next(line for line in lines if line.startswith("column"))
    (row,) = [line for line in lines if line.startswith("cut ")]
    assert row.index("500") + 3 == head.index("rate [Hz]") + 9


@pytest.mark.parametrize(
    ("numbers", "dt"),
    [
        ({"Fs": 500.0}, DT),
        ({"info": {"sampleRate": 500}}, DT),
        ({"dt": DT, "fs": 500.0}, DT),
        ({"dt": DT, "fs": 100.0}, None),
        ({"gain": 500.0}, None),
        ({"Ts": -1.0}, None),
    ],
)
def test_a_number_beside_the_signals_tells_the_period(tmp_path, numbers, dt):
    file = tmp_path / "run.mat"
    scipy.io.savemat(file, {"acc": NOISY, **numbers})
    found = list_columns(file)
    assert found.clock is None
    assert found.timed == (dt is not None)
    assert np.isnan(found.dt) if dt is None else found.dt == pytest.approx(dt)
    assert ("so dt = 0.002?" in found.table()) == (dt is not None)
    begun = write_start(found, tmp_path / "p.toml", {}).read_text(encoding="utf-8")
    assert ("\ndt = 0.002  # [s]" in begun) == (dt is not None)

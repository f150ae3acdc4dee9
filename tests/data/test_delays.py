"""Delays of channels are taken out: by whole samples exactly, by fractions along a line."""

import numpy as np
import pytest

import small_problem
from backsight.data import Column, from_arrays, read, remove_delays
from backsight.errors import DataError
from backsight.problem.reading.loading import load
from backsight.problem.recorded import recording_of

N, DT = 50, 0.01
RAMP = np.arange(N) * 1.0
GIVEN = {"inputs": {"F": "N"}, "outputs": {"q": "m", "p": "m"}}


def recording():
    return from_arrays(u=RAMP, y=np.c_[RAMP, RAMP], dt=DT, **GIVEN)


@pytest.mark.parametrize("shift", [3.0, -2.0, 0.25, -1.5])
def test_an_output_moves_by_itself(shift):
    moved = remove_delays(recording(), {"q": shift * DT})
    at = RAMP + shift
    inside = (at >= 0) & (at <= N - 1)
    np.testing.assert_allclose(moved.y.values[:, 0], np.where(inside, at, np.nan), atol=1e-12)
    np.testing.assert_array_equal(moved.y.values[:, 1], RAMP)
    assert ("interpolated" in moved.attrs.get("understood", "")) == (shift != round(shift))


def test_where_an_input_is_gone_the_recording_is_cut():
    moved = remove_delays(recording(), {"F": 2.5 * DT, "q": -1 * DT})
    assert moved.sizes["time"] == N - 3
    np.testing.assert_allclose(moved.u.values[:, 0], RAMP[: N - 3] + 2.5)
    np.testing.assert_allclose(moved.y.values[1:, 0], RAMP[: N - 4])
    early = remove_delays(recording(), {"F": -2 * DT})
    assert early.time.values[0] == pytest.approx(2 * DT)
    np.testing.assert_allclose(early.u.values[:, 0], RAMP[: N - 2])
    with pytest.raises(DataError, match="leave less than two samples"):
        remove_delays(recording(), {"F": 1.0})
    with pytest.raises(DataError, match="there is no signal 'Q'"):
        remove_delays(recording(), {"Q": 1.0})


def test_missing_samples_stay_missing():
    y = RAMP.copy()
    y[10] = np.nan
    moved = remove_delays(from_arrays(y=y, dt=DT, inputs={}, outputs={"q": ""}), {"q": 0.5 * DT})
    assert np.flatnonzero(np.isnan(moved.y.values[:, 0])).tolist() == [9, 10, N - 1]


def test_a_column_says_its_delay(tmp_path):
    path = tmp_path / "run.csv"
    np.savetxt(path, np.c_[RAMP, RAMP], delimiter=",", header="F,q")
    given = {"inputs": {"F": "F"}, "dt": DT}
    moved = read(path, outputs={"q": Column("q", delay=4 * DT)}, **given)
    np.testing.assert_array_equal(moved.y.values[: N - 4, 0], RAMP[4:])


def test_what_check_proposes_can_be_pasted(tmp_path):
    from typer.testing import CliRunner

    from backsight.cli import app

    small_problem.write(tmp_path)
    t, force, place = small_problem.table().T
    late = np.r_[np.full(3, place[0]), place[:-3]]
    lines = [
        f"{a!r},{b!r},{c!r}"
        for a, b, c in zip(t.tolist(), force.tolist(), late.tolist(), strict=True)
    ]
    (tmp_path / "spring.csv").write_text("\n".join(["t,force,place", *lines]))
    path = tmp_path / "problem.toml"
    found = CliRunner().invoke(app, ["check", str(path)])
    assert found.exit_code == 1
    (remedy,) = [line for line in found.stdout.splitlines() if line.startswith("Into every output")]
    key = remedy.partition(": ")[2]
    assert float(key.partition("=")[2]) == pytest.approx(0.03, abs=0.003)
    mended = small_problem.changed('unit = "m" }', f'unit = "m", {key} }}')
    path.write_text(mended)
    recording_of(load(path))
    assert CliRunner().invoke(app, ["check", str(path)]).exit_code == 0

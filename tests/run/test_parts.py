"""A recording part by part equals the whole, whatever interrupts it."""

import signal
import subprocess
import sys
import textwrap

import h5py
import numpy as np
import pytest

from backsight.analysis.comparison import summary
from backsight.data import from_arrays
from backsight.data.parts import read_parts
from backsight.errors import DataError, OutputError, TuningError
from backsight.estimators import EKF, MHE
from backsight.run.estimation import Outputs, estimate, smooth
from backsight.run.parts import estimate_parts, read_store, smooth_parts
from backsight.testing import TrialProblem

PROBLEM = TrialProblem(outputs=("position",))
METHOD = EKF(PROBLEM.noise, PROBLEM.prior)
DATA = PROBLEM.simulate(131, seed=4, hold="zoh", noisy=True)
DATA.y[50:60] = np.nan
RECORDING = DATA.recording(PROBLEM.model)
NAMES = {"inputs": {"F": "force"}, "outputs": {"position": "place"}, "time": "t", "dt": 0.02}


def written(path, samples=None):
    with h5py.File(path, "w") as file:
        file["t"] = RECORDING["time"].values[:samples]
        file["force"] = RECORDING["u"].values[:samples, 0]
        file["place"] = RECORDING["y"].values[:samples, 0]
    return path


def whole(method, outputs=None, samples=None):
    """Of the recording as it is read: a file says no units."""
    recording = from_arrays(
        u=RECORDING["u"].values[:samples],
        y=RECORDING["y"].values[:samples],
        time=RECORDING["time"].values[:samples],
        dt=0.02,
        inputs={"F": ""},
        outputs={"position": ""},
    )
    return estimate(method, PROBLEM.model, recording, engine="vm", outputs=outputs)


@pytest.mark.parametrize(
    ("method", "samples", "of"),
    [(METHOD, 50, 131), (MHE(PROBLEM.noise, PROBLEM.prior, N=3, lag="N"), 2, 9)],
    ids=["ekf", "looks_back"],
)
def test_parts_are_the_whole(tmp_path, method, samples, of):
    """Also if an estimator looks back further than a part reaches."""
    parts = read_parts(written(tmp_path / "r.h5", of), **NAMES, samples=samples)
    told = estimate_parts(method, PROBLEM.model, parts, tmp_path / "out", engine="vm")
    found, expected = read_store(tmp_path / "out"), whole(method, samples=of)
    assert set(found.data_vars) == set(expected.data_vars)
    for name in expected.data_vars:
        np.testing.assert_array_equal(found[name], expected[name], err_msg=name)
    np.testing.assert_allclose(found["time"], expected["time"], rtol=1e-12)
    said = summary(expected)
    assert float(told["mean_nis"][0]) == pytest.approx(said["mean_nis"], rel=1e-9)
    assert float(told["mean_log_likelihood"][0]) == pytest.approx(
        said["mean_log_likelihood"], rel=1e-9
    )
    np.testing.assert_array_equal(told["x_hat"][0], expected["x_hat"][-1])


def test_thinned_parts_are_the_thinned_whole(tmp_path):
    thin = Outputs(("x_std", "y"), every=7, dtype="float32")
    parts = read_parts(written(tmp_path / "r.h5"), **NAMES, samples=48)
    estimate_parts(METHOD, PROBLEM.model, parts, tmp_path / "out", outputs=thin, engine="vm")
    found, expected = read_store(tmp_path / "out"), whole(METHOD, thin)
    for name in ("x_hat", "x_std", "y", "status"):
        np.testing.assert_array_equal(found[name], expected[name])
        assert found[name].dtype == expected[name].dtype
    some = read_store(tmp_path / "out", variables=["x_std"], start=0.5, stop=1.5)
    assert set(some.data_vars) == {"x_std"}
    assert 0.5 <= float(some.time[0]) <= float(some.time[-1]) < 1.5


def test_a_folder_of_files_without_time_is_one_recording(tmp_path):
    folder = tmp_path / "parts"
    folder.mkdir()
    rows = np.column_stack([RECORDING["u"].values[:, 0], RECORDING["y"].values[:, 0]])
    for k, piece in enumerate(np.array_split(rows, 3)):
        lines = "\n".join(f"{f!r},{'' if np.isnan(y) else repr(y)}" for f, y in piece.tolist())
        (folder / f"p{k}.csv").write_text(f"force,place\n{lines}\n")
    parts = read_parts(folder, **NAMES | {"time": None})
    estimate_parts(METHOD, PROBLEM.model, parts, tmp_path / "out", engine="vm")
    found, expected = read_store(tmp_path / "out"), whole(METHOD)
    np.testing.assert_array_equal(found["x_hat"], expected["x_hat"])
    np.testing.assert_allclose(np.diff(found["time"]), 0.02)


def test_a_run_that_stopped_goes_on_with_the_same_bits(tmp_path):
    parts = read_parts(written(tmp_path / "r.h5"), **NAMES, samples=50)

    def stop(k, _):
        if k == 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        estimate_parts(METHOD, PROBLEM.model, parts, tmp_path / "out", engine="vm", progress=stop)
    begun = []
    first = estimate_parts(
        METHOD, PROBLEM.model, parts, tmp_path / "out", engine="vm",
        progress=lambda k, _: begun.append(k),
    )  # fmt: skip
    assert begun == [1, 2, 3]
    second = estimate_parts(METHOD, PROBLEM.model, parts, tmp_path / "other", engine="vm")
    assert first.identical(second)
    assert read_store(tmp_path / "out").identical(read_store(tmp_path / "other"))


def test_a_process_that_is_killed_loses_the_running_part_only(tmp_path):
    """kill -9 while a part is written: half a file lies about, and is of no harm."""
    written(tmp_path / "r.h5")
    program = textwrap.dedent(
        f"""
        import os, signal, sys
        sys.path.insert(0, {str(__file__.rpartition("/")[0])!r})
        import test_parts as t
        from backsight.run.parts import _store
        parts = t.read_parts({str(tmp_path / "r.h5")!r}, **t.NAMES, samples=50)
        whole = _store.put_in_place
        def killed(part, target):
            if "part-000001" in str(part):
                os.truncate(part, 100)
                os.kill(os.getpid(), signal.SIGKILL)
            whole(part, target)
        _store.put_in_place = killed
        t.estimate_parts(t.METHOD, t.PROBLEM.model, parts, {str(tmp_path / "out")!r}, engine="vm")
        """
    )
    done = subprocess.run([sys.executable, "-c", program], check=False)
    assert done.returncode == -signal.SIGKILL
    assert sorted(p.name for p in (tmp_path / "out").glob("part-*")) == [
        "part-000000.nc",
    ]
    parts = read_parts(tmp_path / "r.h5", **NAMES, samples=50)
    estimate_parts(METHOD, PROBLEM.model, parts, tmp_path / "out", engine="vm")
    np.testing.assert_array_equal(read_store(tmp_path / "out")["x_hat"], whole(METHOD)["x_hat"])
    assert not list((tmp_path / "out").glob(".part*"))


def test_what_does_not_belong_is_refused(tmp_path):
    path = written(tmp_path / "r.h5")
    parts = read_parts(path, **NAMES, samples=60)

    def run(method=METHOD, given=parts, out="out", **more):
        return estimate_parts(method, PROBLEM.model, given, tmp_path / out, engine="vm", **more)

    def second(k, _):
        if k == 1:
            with pytest.raises(OutputError, match="another process writes"):
                run()
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(progress=second)
    with pytest.raises(OutputError, match="results of another estimator"):
        run(EKF(PROBLEM.noise, PROBLEM.prior, measurement="continuous"))
    with pytest.raises(OutputError, match="results of another estimator"):
        run(given=read_parts(path, **NAMES, samples=61))
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "letter.txt").touch()
    with pytest.raises(OutputError, match=r"not from here, such as letter\.txt"):
        run(out="mine")
    with h5py.File(path, "a") as file:
        file["place"][3] = 7.0
    with pytest.raises(DataError, match=r"r\.h5 has changed since it was estimated"):
        run()
    with pytest.raises(TuningError, match="no variable 'P_x'"):
        run(outputs=["P_x"], out="wrong")
    assert not (tmp_path / "wrong").exists()


def test_more_files_go_on_unless_the_estimator_looks_back(tmp_path):
    rows = np.column_stack([RECORDING["u"].values[:12, 0], RECORDING["y"].values[:12, 0]])
    named = NAMES | {"time": None}
    for method, out in ((METHOD, "kf"), (MHE(PROBLEM.noise, PROBLEM.prior, N=2, lag="N"), "mhe")):
        folder = tmp_path / f"from_{out}"
        folder.mkdir()
        for k, piece in enumerate(np.array_split(rows, 2)):
            lines = "\n".join(f"{f!r},{y!r}" for f, y in piece.tolist())
            (folder / f"p{k}.csv").write_text(f"force,place\n{lines}\n")
            parts = read_parts(folder, **named)
            if out == "mhe" and k:
                with pytest.raises(DataError, match="has grown since"):
                    estimate_parts(method, PROBLEM.model, parts, tmp_path / out, engine="vm")
            else:
                estimate_parts(method, PROBLEM.model, parts, tmp_path / out, engine="vm")
    np.testing.assert_array_equal(
        read_store(tmp_path / "kf")["x_hat"], whole(METHOD, samples=12)["x_hat"]
    )


def test_files_that_cannot_be_parts_are_told(tmp_path):
    path = written(tmp_path / "r.h5")
    with pytest.raises(DataError, match="there is no column 'F'"):
        read_parts(path, inputs={"F": "F"}, outputs={"position": "place"}, time="t")
    with pytest.raises(DataError, match="remove_mean and delay need the whole"):
        read_parts(path, **NAMES | {"inputs": {"F": {"name": "force", "remove_mean": True}}})
    with pytest.raises(DataError, match="column of time, or the sampling period"):
        read_parts(path, **NAMES | {"time": None, "dt": None})
    text = tmp_path / "long.csv"
    text.write_text("t,force,place\n0,1,2\n")
    with pytest.raises(DataError, match="cut into files"):
        read_parts(text, **NAMES)
    with pytest.raises(DataError, match="there is no file"):
        read_parts(tmp_path / "none*.csv", **NAMES)
    for k, start in enumerate((0.0, 5.0)):
        rows = "\n".join(f"{start + 0.02 * i},0,0" for i in range(4))
        (tmp_path / f"gap{k}.csv").write_text(f"t,force,place\n{rows}\n")
    parts = read_parts(tmp_path / "gap*.csv", **NAMES)
    with pytest.raises(DataError, match=r"part 1 begins at 5 s, .* 0\.08 s would be next"):
        estimate_parts(METHOD, PROBLEM.model, parts, tmp_path / "gap", engine="vm")


class StoppedError(Exception):
    """Somebody stopped the run."""


@pytest.mark.parametrize("stop", [2, 4, 6])
def test_smoothed_parts_are_the_whole_whatever_interrupts_them(tmp_path, stop):
    """On the way forward, at the end and on the way back: the same to the last bit."""
    parts = read_parts(written(tmp_path / "r.h5"), **NAMES, samples=40)

    def killing(done, _):
        if done == stop:
            raise StoppedError

    out = tmp_path / "out"
    with pytest.raises(StoppedError):
        smooth_parts(METHOD, PROBLEM.model, parts, out, engine="vm", progress=killing)
    told = smooth_parts(METHOD, PROBLEM.model, parts, out, engine="vm")
    found = read_store(out)
    recording = from_arrays(
        u=RECORDING["u"].values,
        y=RECORDING["y"].values,
        time=RECORDING["time"].values,
        dt=0.02,
        inputs={"F": ""},
        outputs={"position": ""},
    )
    expected = smooth(METHOD, PROBLEM.model, recording, engine="vm")
    assert set(found.data_vars) == set(expected.data_vars)
    for name, values in expected.data_vars.items():
        np.testing.assert_array_equal(found[name].values, values.values, err_msg=str(name))
    assert int(told.samples) == len(recording.time)
    rms = np.sqrt(np.nanmean(expected["v"].values ** 2, axis=0))
    np.testing.assert_allclose(told["rms_residual"].values, rms, rtol=1e-12)


def test_what_cannot_be_smoothed_in_parts_is_refused(tmp_path):
    path = written(tmp_path / "r.h5")
    parts = read_parts(path, **NAMES, samples=40)
    with pytest.raises(TuningError, match="keeps every sample"):
        smooth_parts(METHOD, PROBLEM.model, parts, tmp_path / "a", outputs=Outputs(every=2))
    with pytest.raises(TuningError, match="smooth"):
        smooth_parts(MHE(PROBLEM.noise, PROBLEM.prior), PROBLEM.model, parts, tmp_path / "b")
    out = tmp_path / "c"
    smooth_parts(METHOD, PROBLEM.model, parts, out, engine="vm", outputs=["x_std"])
    assert set(read_store(out).data_vars) == {"x_hat", "x_std", "status"}
    with pytest.raises(OutputError, match="another estimator"):
        estimate_parts(METHOD, PROBLEM.model, parts, out, engine="vm")
    written(path, 120)
    parts = read_parts(path, **NAMES, samples=40)
    with pytest.raises(DataError, match="fewer parts"):
        smooth_parts(METHOD, PROBLEM.model, parts, out, engine="vm", outputs=["x_std"])

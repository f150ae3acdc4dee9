"""FMUs at work: run by FMPy over recordings, and beside Python."""

import contextlib
import dataclasses
import shutil
import tempfile

import fmpy
import numpy as np
from fmpy.fmi3 import FMU3ScheduledExecution, FMU3Slave

from backsight.analysis.consistency import nis
from backsight.discrete.runge_kutta import Integrator
from backsight.estimators import EKF
from backsight.estimators.outliers import Gate
from backsight.export import export_fmu
from backsight.run.estimation import estimate
from backsight.testing import TrialProblem


def recorded(problem, hold="zoh"):
    """A noisy recording with gaps."""
    data = problem.simulate(50, seed=5, hold=hold, noisy=True)
    data.y[20:30] = np.nan
    data.y[::7, 0] = np.nan
    return data.recording(problem.model)


def tunable_ekf(folder):
    """An FMU with everything tunable, and what it came from."""
    problem = TrialProblem()
    noise = dataclasses.replace(problem.noise, outliers=Gate())
    estimator = EKF(noise, problem.prior, Integrator("rk4", 2))
    recording = recorded(problem)
    recording["y"][12, 1] += 30.0
    file = export_fmu(
        estimator, problem.model, recording, folder / "ekf.fmu", tunable=["sigma_y", "b"]
    )
    return file, estimator, problem.model, recording


def inputs_of(recording):
    """Inputs of a recording as FMPy takes them, the first sample twice held at the end."""
    columns = {"time": recording["time"].values - float(recording["time"][0])}
    columns |= {f"u.{n}": recording["u"].sel(input=n).values for n in recording["input"].values}
    columns |= {f"y.{n}": recording["y"].sel(output=n).values for n in recording["output"].values}
    table = np.empty(len(columns["time"]), dtype=[(n, np.float64) for n in columns])
    for name, values in columns.items():
        table[name] = values
    return table


def simulated(file, recording, outputs):
    """Outputs (n, m) of an FMU about every sample of a recording, by FMPy's own simulation."""
    dt, given = float(recording.attrs["dt"]), inputs_of(recording)
    # What comes out after a step is about the sample at its beginning.
    given["time"] = np.arange(len(given)) * dt
    rows = fmpy.simulate_fmu(
        str(file),
        stop_time=len(given) * dt,
        output_interval=dt,
        step_size=dt,
        input=given,
        output=list(outputs),
    )
    return np.array([rows[n] for n in outputs], float).T[1:]


def expected(estimator, model, recording):
    """The same by Python: variables of an FMU by their names, (n,) each."""
    found = estimate(estimator, model, recording, engine="vm")
    columns = {"nis": nis(found).values, "status": found["status"].values}
    for group, dim in (
        ("x_hat", "state"),
        ("x_std", "state"),
        ("y_hat", "output"),
        ("e", "output"),
    ):
        for name in found[dim].values:
            columns[f"{group}.{name}"] = found[group].sel({dim: name}).values
    for name in found["state"].values:
        x, sd = columns[f"x_hat.{name}"], columns[f"x_std.{name}"]
        columns[f"x_lower.{name}"] = x - 1.959963984540054 * sd
        columns[f"x_upper.{name}"] = x + 1.959963984540054 * sd
    if "d_hat" in found:
        for name in found["force"].values:
            columns[f"d_hat.{name}"] = found["d_hat"].sel(force=name).values
    return columns


def agrees(file, estimator, model, recording):
    """Compare all that Python knows, too."""
    wanted = expected(estimator, model, recording)
    found = simulated(file, recording, list(wanted))[estimator.delay :]
    wanted = {name: column[: len(found)] for name, column in wanted.items()}
    for name, column in zip(wanted, found.T, strict=True):
        size = np.nanmax(np.abs(wanted[name]), initial=0.0) or 1.0
        np.testing.assert_allclose(column, wanted[name], rtol=0, atol=1e-10 * size, err_msg=name)


@contextlib.contextmanager
def instance(file, given=None, kind=FMU3Slave):
    """An FMU in step mode, with its variables by name; parameters are given before."""
    described = fmpy.read_model_description(str(file))
    folder = tempfile.mkdtemp()
    fmpy.extract(str(file), unzipdir=folder)
    fmu = kind(
        guid=described.guid,
        unzipDirectory=folder,
        modelIdentifier=described.coSimulation.modelIdentifier,
        instanceName="test",
    )
    fmu.instantiate()
    fmu.enterInitializationMode(startTime=0.0)
    references = {v.name: v.valueReference for v in described.modelVariables}
    for name, value in (given or {}).items():
        fmu.setFloat64([references[name]], [value])
    fmu.exitInitializationMode()
    try:
        yield fmu, references
        fmu.terminate()
    finally:
        fmu.freeInstance()
        shutil.rmtree(folder, ignore_errors=True)


def scheduled(file):
    """An FMU whose partition a scheduler activates, see `instance`."""
    return instance(file, kind=FMU3ScheduledExecution)


def walk(fmu, references, samples, first=0):
    """Step over samples from `first` on, and return all outputs as bytes."""
    outputs = [r for name, r in references.items() if name[:2] in ("x_", "e.", "y_", "ni")]
    rows = []
    for k, (u, y) in enumerate(samples, first):
        fmu.setFloat64([references[n] for n in ("u.F", "y.position", "y.speed")], [u, *y])
        fmu.doStep(currentCommunicationPoint=k * 0.02, communicationStepSize=0.02)
        rows.append(np.array(fmu.getFloat64(outputs)).tobytes())
    return rows

"""FMUs in scheduled execution: a tick of the clock is a step."""

import ctypes
import shutil

import numpy as np
import pytest

pytest.importorskip("fmpy")
from fmpy.fmi1 import FMICallException
from fmpy.fmi3 import FMU3Slave
from tests.export.fmus import instance, scheduled, tunable_ekf, walk

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler called cc")


def test_a_tick_of_the_clock_is_a_step(tmp_path):
    """To the last bit; other ticks are refused, and change nothing."""
    file, _, _, recording = tunable_ekf(tmp_path)
    samples = list(zip(recording["u"].values[:, 0], recording["y"].values, strict=True))
    with instance(file) as (fmu, references):
        stepped = walk(fmu, references, samples)
        clock = references["sample"]
        with pytest.raises(FMICallException):
            fmu.fmi3ActivateModelPartition(fmu.component, clock, 50 * 0.02)
    outputs = [r for name, r in references.items() if name[:2] in ("x_", "e.", "y_", "ni")]
    given, ticked = [references[n] for n in ("u.F", "y.position", "y.speed")], []
    interval, told = (ctypes.c_double * 1)(), (ctypes.c_int * 1)()
    with scheduled(file) as (fmu, _):
        fmu.fmi3GetIntervalDecimal(fmu.component, (ctypes.c_uint * 1)(clock), 1, interval, told)
        assert interval[0] == 0.02
        for k, (u, y) in enumerate(samples):
            fmu.setFloat64(given, [u, *y])
            for wrong in ((clock - 1, k * 0.02), (clock, k * 0.02 + 0.01), (clock, np.nan)):
                with pytest.raises(FMICallException):
                    fmu.activateModelPartition(*wrong)
            fmu.activateModelPartition(clock, k * 0.02)
            ticked.append(np.array(fmu.getFloat64(outputs)).tobytes())
        with pytest.raises(FMICallException):
            FMU3Slave.doStep(fmu, currentCommunicationPoint=1.0, communicationStepSize=0.02)
    assert ticked == stepped

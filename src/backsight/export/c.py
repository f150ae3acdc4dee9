"""An estimator as C99 for a controller, with a test that runs there."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import numpy as np
import xarray as xr

from backsight.description import PositiveOrInfinite, checked
from backsight.engine import vm
from backsight.errors import DataError, EngineError
from backsight.estimators.base import AbstractEstimator
from backsight.export._cpp import cpp_header
from backsight.export._readme import readme
from backsight.export._selftest import Vectors, selftest
from backsight.export._single import check_single
from backsight.export._sketch import sketch
from backsight.export._written import Written, code_of
from backsight.models.model import Model
from backsight.output import whole

ACCURACY = 0.01
"""Largest deviation in single precision, see `export_c`."""

EXACT = 1e-10
"""Largest deviation from Python in double precision, by the largest value of the output."""


@checked(EngineError)
def export_c(
    estimator: AbstractEstimator,
    model: Model,
    recording: xr.Dataset,
    out: str | os.PathLike[str],
    *,
    name: str = "estimator",
    precision: Literal["double", "float"] = "double",
    accuracy: PositiveOrInfinite = ACCURACY,
    tunable: Sequence[str] | None = None,
    restart: bool = False,
    template: Literal["arduino"] | None = None,
    force: bool = False,
) -> Path:
    """Write ``name.c``, ``name.h``, a class for C++, a self-test, a Makefile and a README.

    The code is C99 that needs nothing but ``<math.h>``: no allocation, no recursion, no global
    variables, and loops whose largest number of passes is fixed. The self-test compares it with
    Python on the first samples of the recording.

    Parameters
    ----------
    estimator : AbstractEstimator
    model : Model
    recording : xarray.Dataset
        Gives the sampling period and the data of the self-test.
    out : path
        Folder.
    name : str
        Prefix of files, types and functions.
    precision : {"double", "float"}
        Type of all numbers. Code in ``float`` is compiled and run here, and refused if it is not
        accurate.
    accuracy : float
        Of ``float``: largest deviation from Python, of an estimate by its smallest standard
        deviation on the recording, of other outputs by their largest value. With infinity it is
        not tried here.
    tunable : sequence of str, optional
        What may be changed on the controller: ``"sigma_y"``, the standard deviations of the sensors
        (by default, where the estimator takes them from sample to sample), ``"sigma_w"``, random
        walks of states, ``"x0"`` and ``"sigma_x0"``, the prior, ``"lower"`` and ``"upper"``, bounds
        of states, numbers of the estimator, such as ``"alpha"`` or ``"lam"``, and parameters of the
        model. They are in a struct of settings; the exported values are its defaults.
    restart : bool
        After a sample whose estimate is not finite start anew from the prior; the status of that
        sample says so.
    template : {"arduino"}, optional
        ``"arduino"``: the folder is a sketch, for the Arduino IDE and PlatformIO, with a program
        that takes a sample every period; without self-test and Makefile.
    force : bool
        Replace files of the same names in the folder that are not from an earlier export.

    Returns
    -------
    Path
        The folder.

    Raises
    ------
    EngineError
        If the name is no identifier, the estimator cannot be written in C, what shall be tunable
        cannot be without another result, or single precision is not accurate.
    DataError
        If the recording does not fit the model or the self-test would not be finite.
    OutputError
        If the folder cannot be written, or holds files of the same names that are not from an
        earlier export.

    Examples
    --------
    >>> spring = bs.sdof(k=40.0, b=0.8)
    >>> recording = bs.simulate(spring, [[1.0]] * 20, dt=0.05, sigma_y=1e-3, seed=1)
    >>> kf = bs.KalmanFilter(bs.Noise(sigma_y=1e-3, sigma_w=1e-5), bs.Prior(sigma_x0=1.0))
    >>> folder = bs.export.export_c(kf, spring, recording, "code", name="kf")
    >>> sorted(path.name for path in folder.glob("*.[ch]"))
    ['kf.c', 'kf.h', 'kf_selftest.c']
    """
    code = code_of(
        estimator,
        model,
        recording,
        name=name,
        precision=precision,
        names=tunable,
        restart=restart,
    )
    vectors = vectors_of(code)
    told = accuracy if np.isfinite(accuracy) else ACCURACY
    tested = {
        f"{name}_selftest.c": selftest(
            vectors,
            name,
            code.kind,
            EXACT if precision == "double" else told,
            settings=bool(code.open.fields),
            begins=code.open.start is not None,
        ),
        "Makefile": _makefile(name, list(code.kernels)),
    }
    if precision == "float" and np.isfinite(accuracy):
        check_single(code, {**code.files, **tested}, vectors)
    files = {
        **code.files,
        f"{name}.hpp": cpp_header(code),
        **(tested if template is None else sketch(code, Path(out))),
        "README.md": readme(code, tested=template is None),
    }
    with whole(out, names=files, force=force) as folder:
        for file, text in files.items():
            (folder / file).write_text(text, encoding="utf-8")
    return Path(out)


def vectors_of(code: Written) -> Vectors:
    """What goes into the first samples and must come out.

    Raises
    ------
    DataError
        If anything of that is not finite.
    """
    recursion = code.open.plain
    _, outputs = vm.run(recursion, code.data, carry=recursion.carry0)
    for channel, values in zip(recursion.channels, outputs, strict=True):
        if not np.all(np.isfinite(values)):
            raise DataError(
                f"'{channel.name}' is not finite within the first {len(values)} samples, so that "
                "there is nothing to test against; run the estimator on the recording first"
            )
    names = ("u", "y", "mask")
    return Vectors(
        inputs=dict(zip(names, code.data, strict=True)),
        outputs={c.name: o for c, o in zip(recursion.channels, outputs, strict=True)},
    )


def _makefile(name: str, kernels: list[str]) -> str:
    needed = " ".join([f"{name}.c", f"{name}_selftest.c", f"{name}.h", *kernels])
    return f"""CC ?= cc
WARNINGS ?= -pedantic -Wall -Wextra -Wshadow -Wconversion -Wdouble-promotion -Wvla -Werror
CFLAGS ?= -std=c99 -O2 $(WARNINGS)

test: {name}_selftest
\t./{name}_selftest

{name}_selftest: {needed}
\t$(CC) $(CFLAGS) -o $@ {name}.c {name}_selftest.c -lm

clean:
\trm -f {name}_selftest

.PHONY: test clean
"""

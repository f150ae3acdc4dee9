"""An estimator as source code, for whatever is made of it."""

import dataclasses
from collections.abc import Sequence
from importlib.metadata import version

import numpy as np
import xarray as xr

from backsight.engine.c99 import Precision
from backsight.engine.c99 import source as c99
from backsight.engine.program import Program, While, flat
from backsight.engine.recursion import Recursion
from backsight.errors import EngineError, printable
from backsight.estimators.base import AbstractEstimator
from backsight.export._tunable import Tunable, tunable
from backsight.kernels import sources
from backsight.models.model import Model
from backsight.run.estimation import match
from backsight.types import Array

SAMPLES = 200
"""Samples of the recording that tests run through."""


@dataclasses.dataclass(frozen=True)
class Written:
    """Source code of an estimator with what it came from.

    Parameters
    ----------
    name : str
        Prefix of files, types and functions.
    kind : Precision
    estimator, model : AbstractEstimator, Model
    open : Tunable
        The recursion, and what of it may be changed.
    program : Program
    source : Source
    data : list of array
        u, y and mask of the first samples of the recording.
    """

    name: str
    kind: Precision
    estimator: AbstractEstimator
    model: Model
    open: Tunable
    program: Program
    source: c99.Source
    data: list[Array]

    @property
    def recursion(self) -> Recursion:
        """With those settings before the data that are inputs of the step."""
        return self.open.recursion

    @property
    def passes(self) -> list[int]:
        """Largest numbers of passes of the searches, outer before inner."""
        return [s.limit for s in flat(self.program.body) if isinstance(s, While)]

    @property
    def kernels(self) -> dict[str, str]:
        """Files that the code includes, by name."""
        if not self.source.kernels:
            return {}
        return {f.name: f.read_text("utf-8") for f in sources.files(self.source.kernels)}

    @property
    def files(self) -> dict[str, str]:
        """Header, code and what it includes, by name."""
        own = {f"{self.name}.h": self.source.header, f"{self.name}.c": self.source.code}
        return own | self.kernels


def code_of(
    estimator: AbstractEstimator,
    model: Model,
    recording: xr.Dataset,
    *,
    name: str,
    precision: str = "double",
    names: Sequence[str] | None,
    restart: bool,
    most: float = np.inf,
) -> Written:
    """Write an estimator in C, see `backsight.export.export_c` and `write_c99`."""
    if not (name.isidentifier() and name.isascii()):
        raise EngineError(f"'{name}' is no name in C: use letters, digits and underscores")
    if name in ("kernels", *sources.names()):
        raise EngineError(f"'{name}' is the name of a file of the export: choose another one")
    kind = Precision(precision)  # type: ignore[arg-type] - it says which there are
    dt = float(recording.attrs["dt"])
    data = [d[:SAMPLES] for d in match(model, recording, estimator=estimator)]
    found = tunable(estimator, model, dt, names=names, data=data, restart=restart)
    recursion = found.recursion
    source = c99.write_c99(
        found.program,
        name=name,
        begin=found.start,
        start=np.asarray(recursion.carry0).tolist(),
        results=[c.name for c in recursion.channels],
        precision=kind,
        about=f"{estimator.title} for '{one_line(model.name)}', every {recursion.dt:g} s.\n"
        f"Written by Backsight {version('backsight')}; change the model, not this file.",
        settings=found.fields,
        most=most,
    )
    return Written(name, kind, estimator, model, found, found.program, source, data)


def one_line(text: str) -> str:
    """Text without line ends and control characters."""
    return printable(" ".join(text.split()))

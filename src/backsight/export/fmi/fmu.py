"""An estimator as an FMU for co-simulation and scheduled execution, FMI 3.0.

Source: Modelica Association, "Functional Mock-up Interface Specification", version 3.0,
https://fmi-standard.org/docs/3.0/.
"""

import io
import os
import tempfile
import uuid
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import xarray as xr

from backsight.description import checked
from backsight.errors import EngineError, OutputError
from backsight.estimators.base import AbstractEstimator
from backsight.export._compiler import TARGETS, Platform, this_machine
from backsight.export._written import Written, code_of
from backsight.export.fmi._build import build, library_name
from backsight.export.fmi._description import build_description, model_description, terminals
from backsight.export.fmi._model_header import model_header
from backsight.export.fmi._page import icon, page
from backsight.export.fmi._variables import variables
from backsight.models.model import Model
from backsight.output import write_whole

WRAPPER = tuple(sorted(file.name for file in Path(__file__).parent.glob("*.[ch]")))
"""Files in C that all FMUs share."""

MOST = 16_000
"""Numbers in tables of the code; if there are more, they are once in the folder of resources, and
not in each library and the sources."""

MOMENT = (1980, 1, 1, 0, 0, 0)
"""Of all files in the archive, so that the same estimator gives the same bytes."""


@checked(EngineError)
def export_fmu(
    estimator: AbstractEstimator,
    model: Model,
    recording: xr.Dataset,
    out: str | os.PathLike[str],
    *,
    name: str = "estimator",
    tunable: Sequence[str] | None = None,
    platforms: Sequence[Platform] | None = None,
    restart: bool = False,
    force: bool = False,
) -> Path:
    """Write an FMU, FMI 3.0, with sources and a library for every platform.

    A communication step is a sample: inputs are ``u``, ``y`` and ``mask`` at its beginning, outputs
    after it the states with standard deviations and 95 % bands, the innovations, their normalised
    square, the status, and what else the estimator tells of that sample. Measurements that are
    ``NaN`` were not made. The state can be kept, set and serialised.

    Parameters
    ----------
    estimator : AbstractEstimator
    model : Model
    recording : xarray.Dataset
        Gives the sampling period, and data on which what is tunable is compared.
    out : path
        The file, ``*.fmu``.
    name : str
        Model identifier: names of libraries and of functions in C.
    tunable : sequence of str, optional
        As in `export_c`: they become tunable parameters of the FMU, ``sigma_y.*``, ``alpha``,
        ``parameter.*``; ``x0.*`` and ``sigma_x0.*`` fixed ones, which count before the first step.
    platforms : sequence of str, optional
        ``"x86_64-linux"``, ``"aarch64-linux"``, ``"x86_64-windows"``, ``"x86_64-darwin"``,
        ``"aarch64-darwin"``; by default the one of this machine. Others than that need
        ``backsight[fmi]``, which brings a compiler for all of them. None: sources only.
    restart : bool
        See `export_c`.
    force : bool
        Replace a file that is no FMU from here.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    EngineError
        If the name is no identifier, the estimator cannot be written in C, what shall be tunable
        cannot be, or there is no compiler for a platform.
    DataError
        If the recording does not fit the model.
    OutputError
        If the file cannot be written, or would replace one that is not from here.

    Examples
    --------
    >>> spring = bs.sdof(k=40.0, b=0.8)
    >>> recording = bs.simulate(spring, [[1.0]] * 20, dt=0.05, sigma_y=1e-3, seed=1)
    >>> kf = bs.KalmanFilter(bs.Noise(sigma_y=1e-3, sigma_w=1e-5), bs.Prior(sigma_x0=1.0))
    >>> bs.export.export_fmu(kf, spring, recording, "kf.fmu", platforms=()).name  # sources only
    'kf.fmu'
    """
    target = Path(out)
    _check_place(target, force=force)
    if f"{name}.h" in (*WRAPPER, "model.h") or name == "fmu":
        raise EngineError(f"'{name}' is the name of a file of the FMU: choose another one")
    wanted = list(dict.fromkeys([this_machine()] if platforms is None else platforms))
    if unknown := [p for p in wanted if p not in TARGETS]:
        raise EngineError(f"FMUs are not made for {unknown[0]}: choose from {', '.join(TARGETS)}")
    code = code_of(
        estimator, model, recording, name=name, names=tunable, restart=restart, most=MOST
    )
    return write_whole(target, _archive(_content(code, wanted)))


def _content(code: Written, platforms: Sequence[str]) -> dict[str, bytes]:
    """All files of the FMU by their paths."""
    found = variables(code)
    everything = "\n".join([*code.files.values(), *(v.name for v in found)])
    token = f"{{{uuid.uuid5(uuid.NAMESPACE_URL, everything)}}}"
    own = Path(__file__).parent
    sources = {
        **{n: (own / n).read_text("utf-8") for n in WRAPPER},
        "model.h": model_header(code, found, token),
        **code.files,
    }
    compiled = ["fmu.c", f"{code.name}.c"]
    return {
        "modelDescription.xml": model_description(code, found, token),
        **_resources(code),
        **_libraries(code.name, sources, compiled, platforms),
        **{f"sources/{n}": text.encode() for n, text in sources.items()},
        "sources/buildDescription.xml": build_description(code, compiled),
        "documentation/index.html": page(code, found).encode(),
        "terminalsAndIcons/terminalsAndIcons.xml": terminals(found),
        "terminalsAndIcons/icon.png": icon(),
    }


def _resources(code: Written) -> dict[str, bytes]:
    tables = np.array(code.source.tables, dtype="<f8")
    return {"resources/tables.bin": tables.tobytes()} if tables.size else {}


def _libraries(
    name: str, sources: Mapping[str, str], compiled: list[str], platforms: Sequence[str]
) -> dict[str, bytes]:
    with tempfile.TemporaryDirectory(prefix="backsight-fmu-") as temporary:
        folder = Path(temporary)
        for file, text in sources.items():
            (folder / file).write_text(text, encoding="utf-8")
        return {library_name(name, p): build(folder, compiled, p) for p in platforms}


def _archive(content: Mapping[str, bytes]) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for path, data in content.items():
            entry = zipfile.ZipInfo(path, MOMENT)
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, data, zipfile.ZIP_DEFLATED, compresslevel=9)
    return buffer.getvalue()


def _check_place(target: Path, *, force: bool) -> None:
    """Raise `OutputError` if a file would be replaced that is no FMU from here."""
    if target.suffix != ".fmu":
        raise OutputError(f"'{target}': the name of an FMU ends with .fmu")
    if not target.exists() or force:
        return
    try:
        with zipfile.ZipFile(target) as archive:
            described = archive.open("modelDescription.xml").read(2000)
    except (OSError, KeyError, zipfile.BadZipFile):
        described = b""
    if b'generationTool="Backsight' not in described:
        raise OutputError(
            f"'{target}' is not from here and would be replaced; choose another name, or replace "
            "it: --force (force=True)"
        )

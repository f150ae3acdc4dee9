"""Options that several commands have."""

from pathlib import Path
from typing import Annotated

import typer

Out = Annotated[Path, typer.Option("--out", "-o", help="Folder for the results.")]
Force = Annotated[
    bool, typer.Option("--force", help="Replace files that are there, also if not from here.")
]
Outside = Annotated[
    list[str] | None,
    typer.Option(help="Another file that an HDF5, NetCDF or MAT recording may read from."),
]
Env = Annotated[
    list[str] | None,
    typer.Option(help="Environment variable that paths may use beside BACKSIGHT_DATA."),
]

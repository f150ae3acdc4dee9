"""Options that several commands have."""

from typing import Annotated

import typer

Force = Annotated[
    bool, typer.Option("--force", help="Replace files that are there, also if not from here.")
]
Outside = Annotated[
    list[str] | None,
    typer.Option(help="Another file that an HDF5, NetCDF or MAT recording may read from."),
]

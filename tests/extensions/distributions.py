"""Distributions with entry points, as pip leaves them in a folder that Python looks into."""

import shutil
import tomllib
from pathlib import Path


def install(
    folder: Path, name: str, modules: dict[str, str], **entry_points: dict[str, str]
) -> Path:
    """Write modules and what pip knows about them.

    Parameters
    ----------
    folder : Path
        To be put on Python's path.
    name : str
        Of the distribution; its version is 0.1.
    modules : dict
        Name to source.
    entry_points : dict
        Group, without ``backsight.``, to the entries.
    """
    about = folder / f"{name.replace('-', '_')}-0.1.dist-info"
    about.mkdir(parents=True)
    (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 0.1\n")
    lines = []
    for group, entries in entry_points.items():
        lines += [f"[backsight.{group}]", *(f"{k} = {v}" for k, v in entries.items())]
    (about / "entry_points.txt").write_text("\n".join(lines))
    for module, source in modules.items():
        (folder / f"{module}.py").write_text(source)
    return folder


def install_project(project: Path, folder: Path) -> Path:
    """Install a project of pure Python as its ``pyproject.toml`` says, without any network."""
    about = tomllib.loads((project / "pyproject.toml").read_text(encoding="utf-8"))
    named = about["project"]
    info = folder / f"{named['name'].replace('-', '_')}-{named['version']}.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(
        f"Metadata-Version: 2.1\nName: {named['name']}\nVersion: {named['version']}\n"
    )
    lines = []
    for group, entries in named["entry-points"].items():
        lines += [f"[{group}]", *(f"{k} = {v}" for k, v in entries.items())]
    (info / "entry_points.txt").write_text("\n".join(lines))
    for package in about["tool"]["setuptools"]["packages"]:
        shutil.copytree(project / package, folder / package)
    return folder

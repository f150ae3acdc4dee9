"""Distributions with entry points, as pip leaves them in a folder that Python looks into."""

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

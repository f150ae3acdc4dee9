"""Print the oldest versions that are allowed, as constraints for pip."""

import re
import tomllib
from pathlib import Path

TABLE = Path(__file__).parents[1] / "pyproject.toml"


def lowest() -> dict[str, str]:
    """Package to its lower bound, of everything that the package cannot do without."""
    needed = tomllib.loads(TABLE.read_text(encoding="utf-8"))["project"]["dependencies"]
    found = {}
    for line in needed:
        match = re.fullmatch(r"([\w.-]+)>=([\w.]+)", line)
        if match is None:
            raise ValueError(f"pyproject.toml: {line} has no lower bound")
        found[match[1]] = match[2]
    return found


if __name__ == "__main__":
    for name, version in lowest().items():
        print(f"{name}=={version}")

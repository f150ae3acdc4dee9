"""Draw `docs/images/arrival-cost.png`: a figure of the study, from all of its recordings."""

import shutil
import tempfile
from pathlib import Path

from backsight_studies import STUDIES


def draw(path: Path) -> Path:
    """Run the study and keep one of its figures."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        print(STUDIES["arrival"].run(out))
        shutil.copyfile(out / "horizon.png", path)
    return path


if __name__ == "__main__":
    print(draw(Path(__file__).parents[1] / "images" / "arrival-cost.png"))

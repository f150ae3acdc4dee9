"""The unit for systemd, as far as systemd can tell without starting it."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

UNIT = Path(__file__).parents[2] / "examples" / "live" / "backsight.service"


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd is not installed")
def test_systemd_takes_the_unit(tmp_path):
    text = UNIT.read_text().replace("/opt/backsight/bin/backsight", sys.executable)
    assert complaints(tmp_path, text) == []
    assert len(complaints(tmp_path, text.replace("KillSignal", "KillSignl"))) == 1


def complaints(folder: Path, text: str) -> list[str]:
    """What systemd says of a unit."""
    unit = folder / UNIT.name
    unit.write_text(text)
    command = ["systemd-analyze", "verify", "--man=no", str(unit)]
    said = subprocess.run(command, capture_output=True, text=True, check=False).stderr
    return [line for line in said.splitlines() if str(unit) in line]

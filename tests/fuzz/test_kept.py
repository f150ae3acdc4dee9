"""Cases that were found once, and a few new ones of every area."""

from pathlib import Path

import pytest
from tests.fuzz import areas
from tests.fuzz.isolated import case_of, judged

KEPT = Path(__file__).with_name("kept")
FEW = 6
"""New cases of every area: that the fuzzers themselves work."""


@pytest.mark.parametrize("name", areas.NAMES)
def test_nothing_is_said_but_a_clear_line(name, tmp_path):
    area = areas.area(name, tmp_path)
    found = {}
    for file in sorted((KEPT / name).glob("*")):
        found[file.name] = judged(area, file.read_bytes())
    kinds = set()
    for seed in range(FEW):
        found[str(seed)] = judged(area, case_of(area, seed))
        kinds.add(found[str(seed)][0])
    assert not {k: f for k, f in found.items() if f[0] not in ("fine", "refused")}


def test_a_fault_is_found(tmp_path):
    """What the fuzzers look for is seen."""
    import warnings

    from tests.fuzz.isolated import Area

    from backsight.errors import BacksightError

    def attempt(case: bytes) -> None:
        match case:
            case b"a":
                raise TypeError("no")
            case b"b":
                warnings.warn("overflow", RuntimeWarning, stacklevel=1)
            case b"c":
                raise BacksightError("\n" * 30)
            case b"d":
                raise BacksightError("no")

    area = Area("own", lambda draw: b"", attempt)
    kinds = [judged(area, case)[0] for case in (b"a", b"b", b"c", b"d", b"")]
    assert kinds == ["traceback", "warning", "too long a message", "refused", "fine"]

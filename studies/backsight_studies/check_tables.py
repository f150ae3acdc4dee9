"""Tables of checks for the page of a study."""

from collections.abc import Sequence

from backsight_studies import html
from backsight_studies.checks import Check
from backsight_studies.html import Cell


def expected_table(checks: Sequence[Check]) -> str:
    """Numbers beside those that were expected."""
    rows: list[list[str | Cell]] = [
        [c.name, _met(c), _shown(c.paper, 4), _shown(c.measured, 4), _shown(c.tolerance, 2)]
        for c in checks
    ]
    return html.table(["check", "met", "expected", "measured", "tolerance"], rows)


def required_table(checks: Sequence[Check]) -> str:
    """Numbers beside what was required of them."""
    rows: list[list[str | Cell]] = [
        [c.name, _met(c), _shown(c.measured, 3), str(c.tolerance)] for c in checks
    ]
    return html.table(["check", "met", "measured", "required"], rows)


def _met(check: Check) -> Cell:
    return Cell("yes" if check.passed else "no", good=check.passed)


def _shown(value: float | str, digits: int) -> str:
    return value if isinstance(value, str) else f"{value:.{digits}g}"

"""Try changed input of every kind for some time: ``python -m tests.fuzz --seconds 60``.

Prints what was tried and what nobody should see, with the bytes of each in a file of the folder
``--out``. A file that is put into tests/fuzz/kept/AREA is tried by every run of the tests.
"""

import argparse
import collections
import json
import sys
import tempfile
import time
from pathlib import Path

from tests.fuzz import areas
from tests.fuzz.isolated import Area, Found, case_of, tried

MOST_SHOWN = 20


def main() -> int:
    """Return 1 if anything was found."""
    asked = argparse.ArgumentParser(prog="python -m tests.fuzz")
    asked.add_argument("--seconds", type=float, default=60.0, help="for all areas together")
    asked.add_argument("--count", type=int, default=10**9, help="cases of an area at most")
    asked.add_argument("--seed", type=int, default=int(time.time()) % 10**6 * 10**6)
    asked.add_argument("--only", choices=areas.NAMES, action="append")
    asked.add_argument("--out", type=Path, default=Path("out/fuzz"))
    asked.add_argument("--record", type=Path, help="JSON to which the counts are added")
    given = asked.parse_args()
    names = given.only or areas.NAMES
    bad = 0
    with tempfile.TemporaryDirectory() as folder:
        for name in names:
            area = areas.area(name, Path(folder, name))
            share = given.seconds / len(names)
            found = list(
                tried(area, first=given.seed, count=given.count, until=time.monotonic() + share)
            )
            worse = told(area, found, given.out, given.seed)
            bad += worse
            if given.record is not None:
                record(given.record, name, len(found), worse)
    return int(bad > 0)


def record(file: Path, name: str, cases: int, bad: int) -> None:
    """Add counts to those of earlier runs."""
    known = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    before = known.get(name, {"cases": 0, "found": 0})
    known[name] = {"cases": before["cases"] + cases, "found": before["found"] + bad}
    file.write_text(json.dumps(known, indent=1) + "\n", encoding="utf-8")


def told(area: Area, found: list[Found], out: Path, seed: int) -> int:
    """Print what came of an area; the number of cases that nobody should see."""
    kinds = collections.Counter(f.kind for f in found)
    slowest = max((f.seconds for f in found), default=0.0)
    said = ", ".join(f"{count} {kind}" for kind, count in kinds.most_common())
    print(f"{area.name}: {len(found)} cases from seed {seed}: {said}; slowest {slowest:.1f} s")
    groups: dict[tuple[str, str], list[Found]] = {}
    for f in found:
        if f.is_bad:
            groups.setdefault((f.kind, f.where.partition(": ")[0]), []).append(f)
    for (kind, _), same in sorted(groups.items(), key=lambda g: -len(g[1]))[:MOST_SHOWN]:
        shortest = min(same, key=lambda f: len(case_of(area, f.seed)))
        file = out / area.name / str(shortest.seed)
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(case_of(area, shortest.seed))
        print(f"  {kind}, {len(same)} times: {shortest.where}\n    {file}")
    return sum(map(len, groups.values()))


if __name__ == "__main__":
    sys.exit(main())

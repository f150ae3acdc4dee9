"""Fleet files and the tables of recordings that they name, damaged."""

import random
import tomllib
import zlib
from pathlib import Path

import pandas as pd
from tests.fleet.springs import write_fleet
from tests.fuzz.isolated import Area
from tests.fuzz.mutating import mutated_bytes, mutated_text, mutated_tree, text_of

from backsight.fleet import load_fleet, read_rows, run_fleet

FLEET = """
title = "Springs"
problem = "spring.toml"
recordings.table = "runs.csv"
recordings.settings."model.k" = "stiffness"
sweep.noise.sigma_y.y = [1e-3, 2e-3]
"""

TABLES = ("runs.csv", "runs.parquet", "runs.xlsx")

RUNS = 20
"""Of so many fleets that load one is run."""


def area(folder: Path) -> Area:
    """The first byte is 0 for a fleet file, or the number of the table."""
    write_fleet(folder, count=3, fleet=FLEET)
    table = pd.DataFrame(
        {"file": [f"runs/r{k}.csv" for k in range(3)], "stiffness": [40.0, 41.0, 42.0]}
    )
    table.to_csv(folder / TABLES[0], index=False)
    table.to_parquet(folder / TABLES[1], index=False)
    table.to_excel(folder / TABLES[2], index=False)
    right = [(folder / name).read_bytes() for name in TABLES]
    tree = tomllib.loads(FLEET)

    def make(draw: random.Random) -> bytes:
        k = draw.choice([0, 0, 0, 1, 1, 2, 3])
        if k == 0 and draw.random() < 0.7:
            changed = text_of(mutated_tree(tree, draw)).encode("utf-8", "surrogatepass")
        elif k < 2:
            text = FLEET if k == 0 else right[0].decode()
            changed = mutated_text(text, draw).encode("utf-8", "surrogatepass")
        else:
            changed = mutated_bytes(right[k - 1], draw)
        return bytes([k]) + changed

    def attempt(case: bytes) -> None:
        k, content = case[0], case[1:]
        for name, bytes_of in zip(TABLES, right, strict=True):
            (folder / name).write_bytes(bytes_of)
        text = FLEET.replace(TABLES[0], TABLES[max(k - 1, 0)]).encode()
        path = folder / "case.toml"
        path.write_bytes(text if k else content)
        if k:
            (folder / TABLES[k - 1]).write_bytes(content)
        fleet = load_fleet(path)
        if sum(case) % RUNS == 0 and len(fleet.recordings) * len(fleet.settings) < 20:
            out = folder / f"out-{zlib.crc32(case)}"
            run_fleet(fleet, out, workers=0)
            read_rows(out)

    return Area("fleets", make, attempt)

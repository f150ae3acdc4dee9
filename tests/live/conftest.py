"""A small problem, its samples in any order, and a session that is fed by hand."""

import contextlib
import dataclasses
import json
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import backsight as bs
from backsight.live._opening import opened_session
from backsight.live._problem import load_live
from backsight.live._ready import made_ready
from backsight.live._session import LiveSession

DT, N = 0.01, 900

PROBLEM = """
[model]
kind = "equations"
states = { q = "m", v = "m/s" }
outputs = { y = "q" }
parameters = { b = 0.8 }
[model.equations]
q = "v"
v = "u - k*q - b*v"
[estimate]
k = { start = 36.0, sigma = 5.0 }
[prior]
sigma_x0 = { q = 0.1, v = 0.1 }
[noise]
sigma_y = { y = 1e-3 }
sigma_w = { v = 1e-3 }
[estimators.EKF]
kind = "ekf"
"""

COLUMNS = """
inputs.u = { column = "u", unit = "m/s2" }
outputs.y = { column = "y", unit = "m" }
"""

RIG = """
[live]
dt = 0.01
reorder = 0.1
lag = 1.0
bridge = 5.0
[source.rig]
kind = "udp"
port = 0
time = "t"
"""


@pytest.fixture(scope="session")
def samples() -> np.ndarray:
    """Time, input and output of every sample, (n, 3); two outputs are missing."""
    rng = np.random.default_rng(3)
    u = 5 * np.sign(np.sin(0.05 * np.arange(N)) + 0.3 * rng.standard_normal(N))
    plant = bs.sdof(k=40.0, b=0.8)
    made = bs.simulate(plant, u[:, None], dt=DT, sigma_y=1e-3, seed=1)
    found = np.column_stack([DT * np.arange(N), u, made["y"].values[:, 0]])
    found[[300, 301], 2] = np.nan
    return found


@pytest.fixture(scope="session")
def expected(samples, tmp_path_factory) -> xr.Dataset:
    """What `estimate` makes of the samples in order."""
    folder = tmp_path_factory.mktemp("expected")
    live = load_live(written(folder))
    recording = bs.from_arrays(
        u=samples[:, 1], y=samples[:, 2], inputs={"u": "m/s2"}, outputs={"y": "m"}, dt=DT
    )
    return bs.estimate(live.estimator, live.model, recording, engine="vm")


def written(folder: Path, live: str = RIG + COLUMNS) -> Path:
    """Write the problem with these live tables."""
    file = folder / "rig.toml"
    file.write_text(PROBLEM + live)
    return file


def message(row: np.ndarray) -> bytes:
    """A sample as JSON."""
    values = {"t": row[0], "u": row[1], "y": None if np.isnan(row[2]) else row[2]}
    return json.dumps(values).encode()


@dataclasses.dataclass
class Fed:
    """A session that gets its payloads from a test, and what it told and found."""

    session: LiveSession
    told: list[str]

    def feed(self, payloads: Iterable[bytes], *, at_once: int = 37) -> None:
        """Let payloads arrive, so many in a round."""
        waiting = list(payloads)
        for k in range(0, len(waiting), at_once):
            self.session.lanes[0].source.inbox.put_many(waiting[k : k + at_once])
            self.session.round()

    @property
    def counts(self):
        """Of the first source."""
        return self.session.lanes[0].placing.counts


@contextlib.contextmanager
def fed(folder: Path, live: str = RIG + COLUMNS, *, killed: bool = False) -> Iterator[Fed]:
    """Open a session, and close it as Ctrl-C does, or leave it as kill -9 does."""
    told: list[str] = []
    ready = made_ready(load_live(written(folder, live)), engine="vm")
    with opened_session(ready, tell=told.append) as session:
        yield Fed(session, told)
        if not killed:
            session.close()


STORED = RIG + COLUMNS + '[store]\npath = "store"\nevery = 0.05\n'


def stored(folder: Path, names: list[str]) -> dict[str, np.ndarray]:
    """Columns of the store, as pandas reads it."""
    import pandas as pd

    table = pd.read_parquet(folder / "store")
    return {name: table[name].to_numpy() for name in names}

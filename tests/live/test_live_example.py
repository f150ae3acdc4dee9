"""The example: a motor whose bearing wears, with batches that come late."""

import importlib.util
import json
from pathlib import Path

import pytest

from backsight.live._opening import opened_session
from backsight.live._problem import load_live
from backsight.live._ready import made_ready

EXAMPLE = Path(__file__).parents[2] / "examples" / "live"


@pytest.mark.slow
def test_friction_and_load_of_the_simulated_motor(tmp_path):
    spec = importlib.util.spec_from_file_location("simulate", EXAMPLE / "simulate.py")
    assert spec is not None
    assert spec.loader is not None
    simulate = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(simulate)
    file = tmp_path / "live.toml"
    file.write_text((EXAMPLE / "live.toml").read_text())
    told: list[str] = []
    ready = made_ready(load_live(file), engine="vm")
    with opened_session(ready, tell=told.append) as session:
        made = simulate.batches(1.7e9)
        payloads = [json.dumps(next(made)).encode() for _ in range(150)]
        payloads[40], payloads[60] = payloads[60], payloads[40]
        for k in range(0, 150, 25):
            session.lanes[0].source.inbox.put_many(payloads[k : k + 25])
            session.round()
        session._estimate(at_once=True)
        rows = session.newest
        assert rows is not None
        states = [s.name for s in session.live.model.states]
        truth = {"b": simulate.FRICTION, "load_by_J": -0.05 / simulate.J}
        for name, value in truth.items():
            k = states.index(name)
            error = rows.values["x_hat"][-1, k] - value
            assert abs(error) < 3 * rows.values["x_std"][-1, k]
        assert rows.values["x_std"][-1, states.index("load_by_J")] < 10
        assert session.lanes[0].placing.counts.late > 0
        assert session.lanes[0].placing.counts.too_late == 0
    assert not [sentence for sentence in told if "alarm" in sentence]

"""How long every estimator takes to compile for large models: ``python -m benchmarks.compiling``.

Each in a process of its own with an empty cache: from the description to machine code, processor
time of one thread. The model is a structure of many modes, half as many modes as states, whose
sensors see all of them; the forces that some estimators find act at places that move all of them.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Sequence

import numpy as np

from benchmarks.__main__ import ENVIRONMENT

SIZES = ((60, 20), (200, 60), (500, 200))
"""States and outputs."""

HORIZON = 10
"""Of windows [samples]."""

PLACES = 200
"""Where forces may act that the compressive-sensing estimator looks for."""

LONGEST = 120.0
"""Seconds after which an estimator is given up."""

LEAST = 5.0
"""[Hz] to `MOST`: natural frequencies, spread evenly."""
MOST = 60.0


def main() -> None:
    """Print a line for each size and estimator."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.compiling", description=__doc__)
    parser.add_argument("--only", nargs="+", metavar="KEY", help="keys of estimators")
    parser.add_argument("--sizes", nargs="+", metavar="STATES/OUTPUTS", help="such as 200/60")
    parser.add_argument("--one", help=argparse.SUPPRESS)
    given = parser.parse_args()
    sizes = [_size(text) for text in given.sizes] if given.sizes else list(SIZES)
    if given.one:
        print(_told(given.one, *sizes[0]))
        return
    print(
        f"{'states':>6} {'outputs':>7} {'estimator':<10} {'build s':>8} {'code s':>8} {'sum s':>8}"
    )
    for states, outputs in sizes:
        for key in given.only or keys():
            print(f"{states:>6} {outputs:>7} {key:<11} {_apart(key, states, outputs)}", flush=True)


def keys() -> Sequence[str]:
    """All estimators of the table."""
    from backsight.estimators import ESTIMATORS

    return tuple(ESTIMATORS)


def _size(text: str) -> tuple[int, int]:
    states, _, outputs = text.partition("/")
    return int(states), int(outputs)


def _apart(key: str, states: int, outputs: int) -> str:
    """What the process of one estimator prints."""
    with tempfile.TemporaryDirectory() as cache:
        try:
            found = subprocess.run(
                [
                    sys.executable,
                    "-m",
                    "benchmarks.compiling",
                    "--one",
                    key,
                    "--sizes",
                    f"{states}/{outputs}",
                ],
                env=os.environ | ENVIRONMENT | {"BACKSIGHT_CACHE": cache},
                capture_output=True,
                text=True,
                timeout=LONGEST,
            )
        except subprocess.TimeoutExpired:
            return f"more than {LONGEST:.0f} s"
    if found.returncode:
        return f"failed: {(found.stderr.strip().splitlines() or ['without a word'])[-1][:200]}"
    return found.stdout.rstrip()


def _told(key: str, states: int, outputs: int) -> str:
    """Compile one estimator in this process; times, or why it is not offered."""
    from backsight.engine import native
    from backsight.errors import BacksightError

    estimator, model = case(key, states, outputs)
    began = time.process_time()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            recursion = estimator.compile(model, SAMPLED)
    except BacksightError as refused:
        return f"refused: {str(refused)[:150]}"
    built = time.process_time()
    native.compiled(recursion)
    done = time.process_time()
    return f"{built - began:8.2f} {done - built:8.2f} {done - began:8.2f}"


SAMPLED = 1 / (4 * MOST)
"""Sampling period [s]."""


def case(key: str, states: int, outputs: int):
    """An estimator and a model that goes with it."""
    import backsight as bs
    from backsight.estimators import ESTIMATORS

    rng = np.random.default_rng(0)
    modes = states // 2
    hertz = np.linspace(LEAST, MOST, modes)

    def shape() -> np.ndarray:
        return rng.standard_normal(modes)

    unknown = {"joint_input": 5, "csmhe": PLACES}.get(key, 0)
    forces = {f"F{i}": shape() for i in range(unknown)}
    kind = "acceleration" if unknown else "displacement"
    noise = bs.Noise(sigma_y=1.0 if unknown else 1e-3, sigma_w=1e-3)
    prior = bs.Prior(sigma_x0=0.1)
    model = bs.modal(
        hertz,
        damping=0.02,
        sensors={f"y{i}": (kind, shape()) for i in range(1 if key in ("hgo", "ahg") else outputs)},
        forces=forces,
        inputs={"u": shape()},
    )
    settings = {
        "mho": {"N": HORIZON},
        "mhe": {"N": HORIZON},
        "lmhe": {"N": HORIZON, "arrival_weight": 1.0},
        "rmhe": {"N": 2 * states // outputs + HORIZON},
        "joint_input": {"forces": tuple(forces)},
        "csmhe": {"N": HORIZON, "forces": tuple(forces), "lam": 1.0},
        "luenberger": {"poles": tuple(np.linspace(0.5, 0.9, states))},
        "hgo": {"gain": 5.0},
        "ahg": {"gain": 5.0, "Gamma": (1.0,)},
    }
    return ESTIMATORS[key](noise, prior, **settings.get(key, {})), model


if __name__ == "__main__":
    main()

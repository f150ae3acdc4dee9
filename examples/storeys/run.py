"""The same in Python: `python run.py`."""

from pathlib import Path

import backsight as bs

FLOORS = range(1, 6)


def shaken(x, u, p):
    """Rates of all states: floors relative to the ground, and their speeds."""
    return [*(x[f"v{i}"] for i in FLOORS), *(a - u.ground for a in floors(x, p))]


def floors(x, p):
    """What accelerometers on the floors measure: the forces of two storeys by mass."""
    q, v = ([0.0, *(x[f"{s}{i}"] for i in FLOORS)] for s in "qv")
    below = [p[f"k{i}"] * (q[i] - q[i - 1]) + p.c * (v[i] - v[i - 1]) for i in FLOORS]
    return [(above - own) / p.m for own, above in zip(below, [*below[1:], 0.0], strict=True)]


def estimated():
    """Results of both estimators."""
    building = bs.Model(
        f=shaken,
        h=lambda x, _, p: floors(x, p),
        states={f"q{i}": "m" for i in FLOORS} | {f"v{i}": "m/s" for i in FLOORS},
        inputs={"ground": "m/s2"},
        outputs={f"a{i}": "m/s2" for i in FLOORS},
        parameters={f"k{i}": (3e7, "N/m") for i in FLOORS}
        | {"c": (1e5, "N s/m"), "m": (25e3, "kg")},
    )
    unknown = [*(f"k{i}" for i in FLOORS), "c"]
    recording = bs.read(
        Path(__file__).with_name("earthquake.csv"),
        time="t [s]",
        inputs={"ground": "ground [m/s2]"},
        outputs={f"a{i}": f"floor {i} [m/s2]" for i in FLOORS},
    )
    floor_noise = (0.020576, 0.019847, 0.019771, 0.020034, 0.020201)
    noise = bs.Noise(
        sigma_y={f"a{i}": s for i, s in zip(FLOORS, floor_noise, strict=True)},
        sigma_u={"ground": 0.01},
    )
    prior = bs.Prior(
        sigma_x0={f"q{i}": 1e-3 for i in FLOORS}
        | {f"v{i}": 1e-2 for i in FLOORS}
        | {f"k{i}": 6e6 for i in FLOORS}
        | {"c": 5e4}
    )
    return bs.compare(
        {"EKF": bs.EKF(noise, prior), "IEKF": bs.IEKF(noise, prior)},
        bs.augment(building, unknown),
        recording,
    )


if __name__ == "__main__":
    print(estimated())

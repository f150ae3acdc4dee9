"""The same in Python: `python run.py`."""

from pathlib import Path

import backsight as bs

LENGTH, BASE = 24.0, 4.2  # of the bridge, of the truck [m]


def estimated():
    """Results of both estimators."""
    places = {axle: {f"{axle}{i}": 3.0 * i for i in range(1, 8)} for axle in ("front", "rear")}
    span = bs.beam(
        LENGTH,
        bending_stiffness=6e9,
        mass_per_length=4500.0,
        thickness=1.4,
        boundary="pinned-pinned",
        modes=3,
        damping=0.015,
        sensors={
            "third": ("strain", 8.0),
            "middle": ("strain", 12.0),
            "sag": ("displacement", 12.0),
        },
        forces=places["front"] | places["rear"],
    )
    for axle, position in (("front", "s"), ("rear", "s_rear")):
        span = bs.forces.moving_load(
            span, axle, position=position, along=places[axle], supports=(0.0, LENGTH)
        )
    model = bs.augment(span, ["front", "rear"])
    recording = bs.read(
        Path(__file__).with_name("crossing.csv"),
        time="t_s",
        inputs={"s": "axle_m", "s_rear": bs.data.Column("axle_m", factor=1.0, offset=-BASE)},
        outputs={
            "third": bs.data.Column("third_1e-6", factor=1e-6),
            "middle": bs.data.Column("middle_1e-6", factor=1e-6),
            "sag": bs.data.Column("sag_mm", factor=1e-3),
        },
    )
    noise = bs.Noise(sigma_y={"third": 2.0297e-06, "middle": 1.939e-06, "sag": 5.1488e-05})
    modes = {f"q{i}": 1e-2 for i in (1, 2, 3)} | {f"q{i}_dot": 0.1 for i in (1, 2, 3)}
    prior = bs.Prior(sigma_x0=modes | {"front": 3e4, "rear": 5e4}, x0={"front": 5e4, "rear": 5e4})
    rolling = bs.Integrator(hold="foh")  # the truck goes on between the samples
    estimators = {
        "EKF": bs.EKF(noise, prior, integrator=rolling),
        "KF": bs.KalmanFilter(noise, prior, hold="foh"),
    }
    return bs.compare(estimators, model, recording)


if __name__ == "__main__":
    print(estimated())

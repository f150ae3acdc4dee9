"""The same in Python: `python run.py`."""

from pathlib import Path

import backsight as bs


def estimated():
    """Results of both estimators."""
    rotor = bs.from_equations(
        states={"x": "m", "y": "m", "vx": "m/s", "vy": "m/s"},
        inputs={"phi": "rad", "w": "rad/s"},
        outputs={"x_probe": "m", "y_probe": "m"},
        parameters={
            "kx": (2e5, "N/m"),
            "ky": (2e5, "N/m"),
            "d": (100.0, "N s/m"),
            "ex": (0.0, "m"),
            "ey": (0.0, "m"),
            "m": (12.0, "kg"),
        },
        equations={
            "x": "vx",
            "y": "vy",
            "vx": "-(kx*x + d*vx)/m + w**2 * (ex*cos(phi) - ey*sin(phi))",
            "vy": "-(ky*y + d*vy)/m + w**2 * (ex*sin(phi) + ey*cos(phi))",
        },
        output_equations={"x_probe": "x", "y_probe": "y"},
    )
    model = bs.augment(rotor, ["kx", "ky", "d", "ex", "ey"])
    recording = bs.read(
        Path(__file__).with_name("run_up.csv"),
        time="t [s]",
        inputs={"phi": "angle [rad]", "w": "speed [rad/s]"},
        outputs={
            "x_probe": bs.data.Column("x [um]", factor=1e-6),
            "y_probe": bs.data.Column("y [um]", factor=1e-6),
        },
    )
    noise = bs.Noise(
        sigma_y={"x_probe": 1.9681e-06, "y_probe": 1.9739e-06},
        sigma_w={"vx": 2.1871e-05, "vy": 2.5893e-05},
    )
    moving = {"x": 1e-5, "y": 1e-5, "vx": 1e-3, "vy": 1e-3}
    unknown = {"kx": 5e4, "ky": 5e4, "d": 50.0, "ex": 5e-5, "ey": 5e-5}
    prior = bs.Prior(sigma_x0=moving | unknown)
    turning = bs.Integrator(hold="foh")  # the angle goes on between the samples
    estimators = {
        "EKF": bs.EKF(noise, prior, integrator=turning),
        "UKF": bs.UKF(noise, prior, integrator=turning),
    }
    return bs.compare(estimators, model, recording)


if __name__ == "__main__":
    print(estimated())

"""The same in Python, from the German file: `python run.py`."""

from pathlib import Path

import backsight as bs


def estimated():
    """Results of both estimators."""
    motor = bs.from_equations(
        states={"w": "rad/s"},
        inputs={"i": "A"},
        outputs={"speed": "rad/s"},
        parameters={
            "J": (2e-3, "kg m2"),
            "b": (1e-3, "Nm s/rad"),
            "kt": (0.11, "Nm/A"),
            "load": (0.0, "Nm"),
        },
        equations={"w": "(kt*i - b*w - load) / J"},
        output_equations={"speed": "w"},
    )
    model = bs.augment(motor, parameters=["J", "b", "load"])
    recording = bs.read(
        Path(__file__).with_name("motor_german.csv"),
        time="Zeit [s]",
        inputs={"i": "Strom [A]"},
        outputs={"speed": "Drehzahl [rad/s]"},
    )
    noise = bs.Noise(sigma_y=0.050106, sigma_w={"w": 0.0018959, "load": 0.00019218})
    prior = bs.Prior(sigma_x0={"w": 1.0, "J": 5e-4, "b": 1e-3, "load": 0.1})
    return bs.compare(
        {"EKF": bs.EKF(noise, prior), "MHE": bs.MHE(noise, prior, N=20)}, model, recording
    )


if __name__ == "__main__":
    print(estimated())

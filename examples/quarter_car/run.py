"""The same in Python: `python run.py`."""

from pathlib import Path

import backsight as bs


def estimated():
    """Results of both estimators."""
    suspension, tyre = "(ks*s + cs*(vw - vb))", "kt*d"
    body, wheel = f"{suspension} / mb", f"({tyre} - {suspension}) / mw"
    car = bs.from_equations(
        states={"s": "m", "d": "m", "vb": "m/s", "vw": "m/s"},
        outputs={"body": "m/s2", "wheel": "m/s2", "travel": "m"},
        parameters={
            "ks": (1.5e4, "N/m"),
            "cs": (1e3, "N s/m"),
            "mb": (320.0, "kg"),
            "mw": (40.0, "kg"),
            "kt": (2e5, "N/m"),
        },
        equations={"s": "vw - vb", "d": "-vw", "vb": body, "vw": wheel},
        output_equations={"body": body, "wheel": wheel, "travel": "s"},
    )
    recording = bs.read(
        Path(__file__).with_name("ride.csv"),
        time="t [s]",
        inputs={},
        outputs={"body": "body [m/s2]", "wheel": "wheel [m/s2]", "travel": "travel [m]"},
    )
    noise = bs.Noise(
        sigma_y={"body": 0.0501, "wheel": 0.1765, "travel": 0.0010058}, sigma_w={"d": 0.00030358}
    )
    moving = {"s": 0.02, "d": 0.01, "vb": 0.1, "vw": 0.1}
    prior = bs.Prior(sigma_x0=moving | {"ks": 4e3, "cs": 5e2})
    return bs.compare(
        {"EKF": bs.EKF(noise, prior), "MHE": bs.MHE(noise, prior, N=20)},
        bs.augment(car, ["ks", "cs"]),
        recording,
    )


if __name__ == "__main__":
    print(estimated())

"""The same in Python: `python run.py`."""

from pathlib import Path

import backsight as bs

HERE = Path(__file__).parent


def estimated():
    """Result of the estimator that looks for the fewest hits."""
    places = bs.data.read_forces(HERE / "forces.csv")
    sensors = bs.data.read_sensors(HERE / "sensors.csv").sensors
    frame = bs.reduced(
        bs.data.read_matrix(HERE / "mass.mtx"),
        bs.data.read_matrix(HERE / "stiffness.mtx"),
        modes=6,
        damping=0.01,
        fixed=["1:UX", "1:UY", "1:RZ", "13:UX", "13:UY", "13:RZ"],
        sensors=sensors,
        forces=places,
    )
    recording = bs.read(
        HERE / "hits.csv",
        time="t [s]",
        inputs={},
        outputs={name: f"{name} [m/s2]" for name in sensors},
    )
    few = bs.CompressiveSensingMHE(
        bs.Noise(sigma_y=0.05),
        bs.Prior(sigma_x0=[1e-4] * 6 + [1e-2] * 6),
        forces=tuple(places),
        lam=62.313,
        sigma_force=0.05,
        threshold=3.0,
    )
    return bs.compare({"CS-MHE": few}, frame, recording)


if __name__ == "__main__":
    found = estimated()
    print(found)
    for hit in bs.forces.find_impacts(found["CS-MHE"]):
        print(f"{hit.time:.4f} s  {hit.place:7} {1e3 * hit.impulse:7.1f} mN s")

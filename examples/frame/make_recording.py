"""Make the matrices of a portal frame, as a finite-element program writes them, and `hits.csv`."""

import io
import itertools
from pathlib import Path

import numpy as np
import xarray as xr

import backsight as bs

HERE = Path(__file__).parent
DT, SAMPLES, SEED = 1 / 1000, 600, 7
EI, EA, RHO_A = 700.0, 8.4e7, 3.14  # steel flat of 40 x 10 mm: N m2, N, kg/m
HEIGHT, WIDTH, PIECES = 1.0, 1.2, 4  # of the frame [m], elements of each member
NUMBERS = (1, 2, 6)  # of the directions UX, UY, RZ in Abaqus
SIGMA = 0.05  # of every accelerometer [m/s2]
PULSE = (0.5, 1.0, 0.5)  # a soft hammer: force over three samples
HITS = {60: ("left", 60.0), 190: ("middle", -90.0), 330: ("right", -40.0), 450: ("corner", 70.0)}
"""First sample to place and largest force [N]."""

HEADER = f"""\
Simulated recording of a portal frame at {1 / DT:g} Hz, by make_recording.py (seed {SEED}): four
accelerometers with noise of {SIGMA:g} m/s2. Hits of a soft hammer, which no estimator knows:
{", ".join(f"{size:g} N on {place} at {k * DT:g} s" for k, (place, size) in HITS.items())}."""

Point = tuple[float, float]


def corners() -> list[Point]:
    """Nodes from the left foot over both corners to the right foot [m]."""
    steps = np.arange(PIECES) / PIECES
    left = [(0.0, HEIGHT * s) for s in steps]
    top = [(WIDTH * s, HEIGHT) for s in steps]
    right = [(WIDTH, HEIGHT * (1.0 - s)) for s in (*steps, 1.0)]
    return left + top + right


def element(start: Point, end: Point) -> tuple[np.ndarray, np.ndarray]:
    """Mass and stiffness of a plane beam element in global directions, (6, 6) each."""
    (dx, dy), L = np.subtract(end, start), float(np.hypot(*np.subtract(end, start)))
    bend = np.array(
        [
            [12, 6 * L, -12, 6 * L],
            [6 * L, 4 * L**2, -6 * L, 2 * L**2],
            [-12, -6 * L, 12, -6 * L],
            [6 * L, 2 * L**2, -6 * L, 4 * L**2],
        ]
    )
    sway = np.array(
        [
            [156, 22 * L, 54, -13 * L],
            [22 * L, 4 * L**2, 13 * L, -3 * L**2],
            [54, 13 * L, 156, -22 * L],
            [-13 * L, -3 * L**2, -22 * L, 4 * L**2],
        ]
    )
    across, along = np.ix_([1, 2, 4, 5], [1, 2, 4, 5]), np.ix_([0, 3], [0, 3])
    M, K = np.zeros((6, 6)), np.zeros((6, 6))
    M[across], K[across] = RHO_A * L / 420 * sway, EI / L**3 * bend
    M[along] = RHO_A * L / 6 * np.array([[2, 1], [1, 2]])
    K[along] = EA / L * np.array([[1, -1], [-1, 1]])
    c, s = dx / L, dy / L
    turn = np.kron(np.eye(2), [[c, s, 0], [-s, c, 0], [0, 0, 1]])
    return turn.T @ M @ turn, turn.T @ K @ turn


def matrices() -> dict[str, np.ndarray]:
    """Mass and stiffness of the whole frame."""
    nodes = corners()
    M, K = (np.zeros((3 * len(nodes), 3 * len(nodes))) for _ in range(2))
    for i, (start, end) in enumerate(itertools.pairwise(nodes)):
        here = np.ix_(range(3 * i, 3 * i + 6), range(3 * i, 3 * i + 6))
        for whole, part in zip((M, K), element(start, end), strict=True):
            whole[here] += part
    return {"mass.mtx": M, "stiffness.mtx": K}


def matrix_text(matrix: np.ndarray) -> str:
    """Lower triangle as ``node, direction, node, direction, value``."""
    rows = [
        f"{i // 3 + 1},{NUMBERS[i % 3]},{j // 3 + 1},{NUMBERS[j % 3]},{matrix[i, j]:.12e}"
        for i in range(len(matrix))
        for j in range(i + 1)
        if matrix[i, j]
    ]
    return "\n".join(rows) + "\n"


def frame() -> bs.Model:
    """The frame from its files, with a force at every place where a hit is possible."""
    sensors = bs.data.read_sensors(HERE / "sensors.csv")
    return bs.reduced(
        bs.data.read_matrix(HERE / "mass.mtx"),
        bs.data.read_matrix(HERE / "stiffness.mtx"),
        modes=6,
        damping=0.01,
        fixed=[f"{node}:{way}" for node in (1, len(corners())) for way in ("UX", "UY", "RZ")],
        sensors=sensors.sensors,
        forces=bs.data.read_forces(HERE / "forces.csv"),
    )


def simulated() -> xr.Dataset:
    """The recording with its hits as inputs."""
    model = frame()
    places = [force.name for force in model.parameters]
    hits = np.zeros((SAMPLES, len(places)))
    for k, (place, size) in HITS.items():
        hits[k : k + len(PULSE), places.index(place)] = size * np.array(PULSE)
    known = bs.forces.forces_as_inputs(model, places)
    return bs.simulate(known, hits, dt=DT, sigma_y=SIGMA, seed=SEED)


def recording_text() -> str:
    """The whole file as text."""
    made = simulated()
    lines = io.StringIO()
    np.savetxt(
        lines,
        np.column_stack([made["time"], made["y"]]),
        delimiter=",",
        fmt=["%.3f", *["%.3f"] * 4],
    )
    comments = "".join(f"# {line}\n" for line in HEADER.splitlines())
    columns = ",".join(f"{name} [m/s2]" for name in made["output"].values)
    return f"{comments}t [s],{columns}\n{lines.getvalue()}"


if __name__ == "__main__":
    for name, matrix in matrices().items():
        (HERE / name).write_text(matrix_text(matrix), encoding="utf-8", newline="\n")
        print(f"wrote {HERE / name}")
    place = HERE / "hits.csv"
    place.write_text(recording_text(), encoding="utf-8", newline="\n")
    print(f"wrote {place}")

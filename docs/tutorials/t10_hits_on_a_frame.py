"""
Hits on a frame, from its matrices
==================================

A portal frame of steel is hit by a soft hammer. Which places, when, how hard? The model is what a finite-element program
leaves behind: a mass and a stiffness matrix.
"""

# %%
# Two matrices
# ------------
# Twelve beam elements, three directions at every node. Yours come from files (``bs.data.read_matrix`` knows those of Abaqus,
# Nastran, MATLAB and others; `examples/frame` does that); here a few lines write them.

import itertools

import numpy as np

import backsight as bs
from backsight import plot

EI, EA, RHO_A = 700.0, 8.4e7, 3.14  # a flat of 40 x 10 mm [N m2, N, kg/m]
quarter = np.arange(4) / 4
nodes = [
    *((0.0, s) for s in quarter),
    *((1.2 * s, 1.0) for s in quarter),
    *((1.2, 1.0 - s) for s in (*quarter, 1.0)),
]


def element(start, end):
    """Mass and stiffness of a plane beam in global directions."""
    (dx, dy), L = np.subtract(end, start), np.hypot(*np.subtract(end, start))
    k = np.array([[12, 6 * L, -12, 6 * L], [0, 4 * L**2, -6 * L, 2 * L**2]])
    m = np.array([[156, 22 * L, 54, -13 * L], [0, 4 * L**2, 13 * L, -3 * L**2]])
    M, K = np.zeros((6, 6)), np.zeros((6, 6))
    for matrix, half, factor in ((M, m, RHO_A * L / 420), (K, k, EI / L**3)):
        swapped = np.zeros((4, 4))
        swapped[:2] = half
        swapped[2:, 2:] = half[:, :2] * [[1, -1], [1, 1]]
        matrix[np.ix_([1, 2, 4, 5], [1, 2, 4, 5])] = factor * (
            np.triu(swapped) + np.triu(swapped, 1).T
        )
    M[np.ix_([0, 3], [0, 3])] = RHO_A * L / 6 * np.array([[2, 1], [1, 2]])
    K[np.ix_([0, 3], [0, 3])] = EA / L * np.array([[1, -1], [-1, 1]])
    turn = np.kron(np.eye(2), [[dx / L, dy / L, 0], [-dy / L, dx / L, 0], [0, 0, 1]])
    return turn.T @ M @ turn, turn.T @ K @ turn


mass, stiffness = np.zeros((39, 39)), np.zeros((39, 39))
for i, ends in enumerate(itertools.pairwise(nodes)):
    here = slice(3 * i, 3 * i + 6)
    for whole, part in zip((mass, stiffness), element(*ends), strict=True):
        whole[here, here] += part

# %%
# The frame, its sensors, and where a hit is possible
# ---------------------------------------------------
# Six modes of thirty-three. Four accelerometers, six places: more forces than measurements at every sample.

names = [f"{node}:{way}" for node in range(1, 14) for way in ("UX", "UY", "RZ")]
places = {
    "low": "2:UX",
    "left": "4:UX",
    "corner": "5:UX",
    "top": "6:UY",
    "middle": "7:UY",
    "right": "10:UX",
}
frame = bs.reduced(
    mass,
    stiffness,
    modes=6,
    damping=0.01,
    coordinates=names,
    fixed=["1:UX", "1:UY", "1:RZ", "13:UX", "13:UY", "13:RZ"],
    sensors={
        "a1": ("acceleration", "3:UX"),
        "a2": ("acceleration", "5:UX"),
        "a3": ("acceleration", "8:UY"),
        "a4": ("acceleration", "11:UX"),
    },
    forces=places,
)
true = {60: ("left", 60.0), 190: ("middle", -90.0), 250: ("corner", 70.0)}
force = np.zeros((320, 6))
for k, (place, size) in true.items():
    force[k : k + 3, list(places).index(place)] = size * np.array([0.5, 1.0, 0.5])
known = bs.forces.forces_as_inputs(frame, list(places))
recording = bs.simulate(known, force, dt=1e-3, sigma_y=0.05, seed=7).isel(input=[])

# %%
# The fewest hits that explain the motion
# ---------------------------------------

few = bs.CompressiveSensingMHE(
    bs.Noise(sigma_y=0.05),
    bs.Prior(sigma_x0=[1e-4] * 6 + [1e-2] * 6),
    forces=tuple(places),
    lam=10.0,
    sigma_force=0.05,
    threshold=3.0,
)
result = bs.estimate(few, frame, recording)
for hit in bs.forces.find_impacts(result):
    print(f"{hit.time:.4f} s  {hit.place:7} {1e3 * hit.impulse:7.1f} mN s")

# %%
# All three, and nothing else; the impulses are 120, -180 and 140 mN s.

plot.draw_forces(result)

# %%
# Which weight?
# -------------
# ``lam`` is the price of a force. The forces that are found are piecewise linear in it, so they can be had for every price at
# once: what stays over a long stretch of prices is there, what comes and goes is noise. Any weight from 1 to 100 says the same.

path = bs.tune.trace_force_path(few, frame, recording.isel(time=slice(40, 100)))
plot.force_path_figure(path, lam=10.0)

# %%
# **Exercise.** Take ``a3`` away, the only sensor that sees the girder bend. Which hit suffers?
# (``bs.check.check_force_locations(frame, dt=1e-3)`` says it before anything is run.)

"""
From your finite-element model to virtual sensors
=================================================

A mast of steel has two accelerometers. What is wanted is where it goes at the top and the strain at its foot, and nobody
measures the wind. The program that made the model writes its matrices and lists of coordinates to files, and that is enough.
"""

# %%
# What the finite-element program writes
# --------------------------------------
# Two matrices in Matrix Market format, with the coordinates in the order UX and RZ of every node, and a table of the sensors. Here
# a few lines take the place of the program: a cantilever of 40 elements.

import pathlib
import tempfile

import numpy as np
import scipy.io
import scipy.sparse

import backsight as bs
from backsight import plot

ELEMENTS, LENGTH, EI, MASS = 40, 20.0, 2.1e11 * 4e-6, 60.0  # [m], [N m2], [kg/m]
a = LENGTH / ELEMENTS
stiff = EI / a**3 * np.array(
    [[12, 6 * a, -12, 6 * a], [6 * a, 4 * a**2, -6 * a, 2 * a**2],
     [-12, -6 * a, 12, -6 * a], [6 * a, 2 * a**2, -6 * a, 4 * a**2]]
)  # fmt: skip
heavy = MASS * a / 420 * np.array(
    [[156, 22 * a, 54, -13 * a], [22 * a, 4 * a**2, 13 * a, -3 * a**2],
     [54, 13 * a, 156, -22 * a], [-13 * a, -3 * a**2, -22 * a, 4 * a**2]]
)  # fmt: skip
K, M = (scipy.sparse.lil_matrix((2 * ELEMENTS + 2,) * 2) for _ in range(2))
for e in range(ELEMENTS):
    own = slice(2 * e, 2 * e + 4)
    K[own, own] += stiff
    M[own, own] += heavy

folder = tempfile.TemporaryDirectory()
where = pathlib.Path(folder.name)
scipy.io.mmwrite(where / "stiffness.mtx", scipy.sparse.coo_matrix(K))
scipy.io.mmwrite(where / "mass.mtx", scipy.sparse.coo_matrix(M))
(where / "sensors.csv").write_text(
    "name,kind,node,direction,unit,noise\n"
    "A20,acceleration,20,UX,m/s^2,0.01\n"
    "A40,acceleration,40,UX,m/s^2,0.01\n"
)
(where / "forces.csv").write_text("name,node,direction\nwind,34,UX\n")

# %%
# A model of four modes
# ---------------------
# Coordinates have names, ``node:direction``. The foot is held, and virtual sensors are described like those that exist: the strain
# at the foot is what the curvature of the first element says at the surface, 0.15 m from the neutral axis.

names = [f"{n}:{d}" for n in range(ELEMENTS + 1) for d in ("UX", "RZ")]
listed = bs.data.read_sensors(where / "sensors.csv")
mast = bs.reduced(
    bs.data.read_matrix(where / "mass.mtx"),
    bs.data.read_matrix(where / "stiffness.mtx"),
    modes=4,
    damping=0.01,
    coordinates=names,
    fixed=["0:UX", "0:RZ"],
    sensors=listed.sensors,
    forces=bs.data.read_forces(where / "forces.csv"),
    virtual={
        "top": ("displacement", "40:UX"),
        "foot": ("strain", {"1:UX": 0.15 * 6 / a**2, "1:RZ": -0.15 * 2 / a}),
    },
)
mast = bs.with_virtual(mast, {"stress": ("2.1e11 * foot", "Pa")})
mast

# %%
# Wind that nobody measures
# -------------------------
# A steady wind with gusts is simulated, with the truth beside it. The estimator knows two accelerations only; for it the force is a
# state that forgets.

DT = 5e-3
t = DT * np.arange(6000)
rng = np.random.default_rng(4)
gusts = np.zeros(t.size)
for k in range(1, t.size):
    gusts[k] = gusts[k - 1] * np.exp(-DT / 0.4) + 60 * np.sqrt(2 * DT / 0.4) * rng.normal()
blown = bs.forces.forces_as_inputs(mast, ["wind"])
truth = bs.simulate(blown, gusts[:, None], dt=DT, sigma_y=listed.noise, seed=2)
recording = truth.isel(input=[])

windy = bs.augment(mast, forces={"wind": bs.forces.GaussMarkov(sigma=60.0, time=0.4)})
rest = {s.name: (1e-2 if s.name.endswith("_dot") else 1e-3) for s in windy.states}
prior = bs.Prior(sigma_x0={n: v for n, v in rest.items() if n != "wind"})
filter_ = bs.KalmanFilter(bs.Noise(sigma_y=listed.noise), prior)
print(bs.check.check_observability(windy, dt=DT))

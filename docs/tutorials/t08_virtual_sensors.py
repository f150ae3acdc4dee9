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

ELEMENTS, LENGTH, EI, MASS = 40, 20.0, 2.1e11 * 4e-4, 280.0  # [m], [N m2], [kg/m]
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
    "A20,acceleration,20,UX,m/s^2,0.005\n"
    "A40,acceleration,40,UX,m/s^2,0.005\n"
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
# Gusts are simulated, with the truth beside them. An estimator gets two accelerations, and the force is a state that walks.

DT = 0.01
t = DT * np.arange(4000)
rng = np.random.default_rng(4)
gusts = np.zeros(t.size)
for k in range(1, t.size):
    gusts[k] = gusts[k - 1] * np.exp(-DT / 0.4) + 300 * np.sqrt(2 * DT / 0.4) * rng.normal()
blown = bs.forces.forces_as_inputs(mast, ["wind"])
recording = bs.simulate(blown, gusts[:, None], dt=DT, sigma_y=listed.noise, seed=2)
recording = recording.isel(input=[])

walking = bs.augment(mast, ["wind"])
print(bs.check.check_observability(walking))

# %%
# A constant force shows in no acceleration, so that nothing tells where the mast stands. There are two remedies without another
# sensor, and both are knowledge: that the top stays within some centimetres (a **dummy measurement** that reads zero), or how large
# the wind is and after what time it has forgotten (a force that is a **process**).

noise = listed.noise
rest = {s.name: (1e-2 if s.name.endswith("_dot") else 1e-3) for s in mast.states}
walk = {"wind": 67.0}  # [N] from one sample to the next
prior = bs.Prior(sigma_x0={**rest, "wind": 300.0})

anchored = bs.models.with_dummies(bs.with_virtual(walking, {"stays": "top"}), ["stays"])
size, on_one_side = 15e-3, 1 / (2 * np.pi * 0.77)  # RMS [m], and for how long [s]
stays = {"stays": size * np.sqrt(2 * on_one_side / DT)}
process = bs.augment(mast, forces={"wind": bs.forces.GaussMarkov(sigma=300.0, time=0.4)})
ways = {
    "a walk": (bs.KalmanFilter(bs.Noise(sigma_y=noise, sigma_w=walk), prior), walking),
    "a dummy": (
        bs.KalmanFilter(bs.Noise(sigma_y={**noise, **stays}, sigma_w=walk), prior),
        anchored,
    ),
    "a process": (bs.KalmanFilter(bs.Noise(sigma_y=noise), bs.Prior(sigma_x0=rest)), process),
}
found = {name: bs.estimate(way, model, recording) for name, (way, model) in ways.items()}

# %%
# How good, and how honest
# ------------------------
# The simulation knows the truth. An estimate is honest if its error is within three of its deviations nearly always; it is good if
# they are small.

for name, result in found.items():
    for wanted in ("top", "stress"):
        z = result.sel(virtual=wanted).isel(time=slice(500, None))
        error = z.z_hat - z.z_true
        print(
            f"{name:10s}{wanted:7s} error {float(error.std() / z.z_true.std()):4.0%} of the RMS,",
            f"band {float(z.z_std.mean() / z.z_true.std()):4.0%},",
            f"within three {float((abs(error) < 3 * z.z_std).mean()):.1%}",
        )

# %%
# The walk drifts, and says so; the two others agree with the truth and with their bands. The deviation of the dummy is larger than
# the size of the displacement, because a displacement stays on one side for many samples (see :doc:`virtual sensors
# <../virtual-sensors>`); of the process only the size and the time of the wind had to be known.

last = found["a process"].isel(time=slice(2000, 3000))
plot.draw_virtual(last, ["top", "stress"])

# %%
# All of this is one problem file, too: paths stand where the matrices would, ``[virtual]`` and ``[dummy]`` have the outputs, and
# ``backsight check`` proposes the remedies by name. With the sensors of a test, leave one out of the estimation and name it as the
# truth of a virtual output: then you know how good the others are.

folder.cleanup()

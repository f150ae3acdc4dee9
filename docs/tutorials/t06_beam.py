"""
Where, when and how hard: hits on a beam
========================================

Eight places where a beam may be hit, three sensors. Nobody measures the force, and there are fewer sensors than places; but
hits are rare. The compressive-sensing moving horizon estimator looks for the fewest forces that explain the motion.
"""

# %%
# A beam by its geometry
# ----------------------

import numpy as np

import backsight as bs
from backsight import plot

places = {f"F{i + 1}": 0.125 + 0.04 * i for i in range(8)}
beam = bs.beam(
    0.405,
    width=0.025,
    thickness=0.003,
    youngs_modulus=65.9e9,
    density=7502.0,
    boundary="cantilever",
    modes=3,
    damping=[0.030, 0.037, 0.119],
    sensors={f"s{i}": ("displacement", x) for i, x in enumerate((0.245, 0.325, 0.405))},
    forces=places,
)
hits = {40: ("F8", -10.0), 88: ("F7", -5.0), 151: ("F5", 5.0), 210: ("F2", 10.0)}
force = np.zeros((300, 8))
for k, (place, size) in hits.items():
    force[k, list(places).index(place)] = size
known = bs.forces.forces_as_inputs(beam, list(places))
recording = bs.simulate(known, force, dt=1 / 400, sigma_y=2e-6, seed=1)
recording = recording.isel(input=[])  # nobody measures the hits

# %%
# What least squares make of it
# -----------------------------
# More places than sensors: a force at every place cannot be told. What random-walk forces can at most be found is said
# before anything is run.

print(bs.check.check_force_locations(beam, dt=1 / 400).attrs["verdict"])

# %%
# The fewest hits
# ---------------

method = bs.CompressiveSensingMHE(
    bs.Noise(sigma_y=2e-6),
    bs.Prior(sigma_x0=[1e-5] * 3 + [1e-3] * 3),
    forces=tuple(places),
    lam=15.0,
    sigma_force=0.1,
    threshold=0.5,
)
result = bs.estimate(method, beam, recording)
for hit in bs.forces.find_impacts(result):
    size = hit.impulse / (hit.end - hit.start)
    print(f"{hit.time:.4f} s  {hit.place}  {size:6.2f} N")

# %%
# Colour is the force, circles are the hits that were found: all four are there, at the right places.

plot.draw_forces(result)

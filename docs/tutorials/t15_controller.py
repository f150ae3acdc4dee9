"""
From a notebook to a controller
===============================

What ran here runs there: the estimator becomes C99 without allocation, with a self-test made of your own recording.
"""

# %%
import subprocess
import tempfile
from pathlib import Path

import numpy as np

import backsight as bs
from backsight import plot

model = bs.augment(bs.sdof(k=40.0, b=0.8, c=1.0), parameters=["k"])
force = np.sign(np.sin(0.05 * np.arange(500)))[:, None]
recording = bs.simulate(bs.sdof(k=40.0, b=0.8, c=1.0), force, dt=0.01, sigma_y=1e-3, seed=1)
ekf = bs.EKF(
    bs.Noise(sigma_y=1e-3, sigma_w={"v": 1e-3, "k": 0.05}),
    bs.Prior(sigma_x0={"q": 0.1, "v": 0.1, "k": 5.0}),
)
folder = bs.export.export_c(ekf, model, recording, Path(tempfile.mkdtemp(), "controller"))
print(*sorted(p.name for p in folder.iterdir() if not p.name.startswith(".")))

# %%
# What it will say, sample by sample:

plot.draw_states(bs.estimate(ekf, model, recording), ["k"], reference={"k": 40.0})

# %%
# The header is all that your program sees
# ----------------------------------------

header = (folder / "estimator.h").read_text()
print(header[-1800:])

# %%
# The self-test compares with Python
# ----------------------------------

done = subprocess.run(["make", "test"], cwd=folder, capture_output=True, text=True, check=True)
print(done.stdout[-400:])

# %%
# Tuned on the target
# -------------------
# Noise, prior and damping are settings with the exported values as defaults: another sensor needs no new export.

tuned = bs.export.export_c(
    ekf,
    model,
    recording,
    folder.with_name("tuned"),
    tunable=["sigma_y", "sigma_w", "sigma_x0", "b"],
)
header = (tuned / "estimator.h").read_text()
print(header[header.index("/* What may be changed") : header.index("/* Process one sample")])

# %%
# What a step costs at most
# -------------------------

print(
    *(line for line in (tuned / "README.md").read_text().splitlines() if "at most" in line),
    sep="\n",
)

# %%
# Into a system simulation
# ------------------------
# The same code as an FMU (FMI 3.0): one communication step is one sample.

fmu = bs.export.export_fmu(ekf, model, recording, folder.with_name("controller.fmu"))
print(fmu.name, f"{fmu.stat().st_size / 1000:.0f} kB")

"""
From your file to a result
==========================

A logger wrote a text as loggers do: a head, decimal commas, dates with the day first, a line of units, a code where nothing was
measured. From there to a stiffness with its band are four steps: look, read, describe, estimate.
"""

# %%
# The file
# --------
# A mass on a spring is pushed, and its way is measured. Here a few lines take the place of the logger.

import pathlib
import tempfile

import numpy as np

import backsight as bs
from backsight import plot


def mass_on_a_spring(k, b):
    """Equations as text; the mass is 2 kg."""
    return bs.from_equations(
        states={"q": "m", "v": "m/s"},
        inputs={"F": "N"},
        outputs={"y": "m"},
        parameters={"k": k, "b": b},
        equations={"q": "v", "v": "(F - k*q - b*v) / 2.0"},
        output_equations={"y": "q"},
    )


rig = mass_on_a_spring((900.0, "N/m"), (3.0, "N s/m"))
t = 0.01 * np.arange(1500)
push = 4 * np.sign(np.sin(2 * np.pi * 0.35 * t))
motion = bs.simulate(rig, push[:, None], dt=0.01, sigma_y=5e-5, seed=3)

folder = tempfile.TemporaryDirectory()
path = pathlib.Path(folder.name, "Messung 7.txt")
way = 1e3 * motion.y.values[:, 0]
way[700:712] = -999
rows = [
    f"27/03/2026 10:51:{int(s):02d},{round(1000 * (s % 1)):03d};{f:.2f};{w:.3f}".replace(".", ",")
    for s, f, w in zip(t, push, way)
]
head = ["Logger 3000;;", "Serie 12;;", "Zeit;Kraft;Weg", ";N;mm"]
path.write_text("\n".join([*head, *rows, "Messung beendet;;"]), encoding="utf-16")

# %%
# Look
# ----
# What is in it, and what looks wrong? On the command line this is ``backsight columns FILE``.

found = bs.data.list_columns(path)
found

# %%
# Read
# ----
# One line names the columns. How the text was understood is said where it could be seen otherwise; the code that stands for "not
# measured" was found above.

recording = bs.read(
    path,
    time="Zeit",
    inputs={"F": "Kraft"},
    outputs={"y": {"name": "Weg", "unit": "m"}},
    missing=found.codes,
)
print(recording.attrs["understood"])
print(
    "begins", recording.attrs["begin"], "with a sample every", round(recording.attrs["dt"], 9), "s"
)
print(int(recording.y.isnull().sum()), "samples were not measured; the largest is",
      f"{float(abs(recording.y).max()):.4f} m")  # fmt: skip

# %%
# Describe
# --------
# The mass is known from the scales, stiffness and damping only by guess. Both are positive, and become states beside the motion.

guess = mass_on_a_spring(
    bs.Signal("N/m", 800.0, positive=True), bs.Signal("N s/m", 2.0, positive=True)
)
model = bs.augment(guess, ["k", "b"])
sigma = {"q": 1e-3, "v": 1e-2, "k": 150.0, "b": 1.0}
ekf = bs.EKF(
    bs.Noise(sigma_y=5e-5), bs.Prior(sigma_x0=sigma), integrator=bs.Integrator("rk4", substeps=2)
)

# %%
# Estimate
# --------
# The gap needs nothing: there the estimate goes on without a measurement.

result = bs.estimate(ekf, model, recording)
print(bs.check.check_consistency(result))
for name, true in (("k", 900.0), ("b", 3.0)):
    last = result.sel(state=name).isel(time=-1)
    print(
        f"{name} = {float(last.x_hat):.4g} ± {float(last.x_std):.2g}; the simulation had {true:g}"
    )
plot.draw_states(result, ["q", "k"])

# %%
# The same as a problem file
# --------------------------
# ``backsight init FILE`` writes one with the columns that it found; then the model takes the place of the smoothing one. It is all
# that ``backsight run`` needs, and a colleague, too:
#
# .. code-block:: toml
#
#    [recording]
#    path = "Messung 7.txt"
#    time = "Zeit"
#    missing = [-999]
#    inputs.F = "Kraft"
#    outputs.y = { name = "Weg", unit = "m" }
#
# Other files are read by the same line: see :doc:`your file <../your-file>`.

folder.cleanup()

"""
Consistency
===========

A filter says how wrong it may be. Whether that is true can be seen without the truth, because it predicts every measurement before
it sees it: predictions with honest bands have errors as large as the bands, and none of them follows from another.
"""

# %%
# What innovations must be
# ------------------------
# Let :math:`e_k = y_k - \hat y_{k|k-1}` with the covariance :math:`S_k` that the filter claims. If model and noise are right, the
# :math:`e_k` are independent normal numbers, so that
#
# .. math:: \mathrm{NIS}_k = e_k^\top S_k^{-1} e_k \sim \chi^2_m, \qquad
#    \frac1n \sum_k \mathrm{NIS}_k \in m \pm 2 \sqrt{2 m / n} .
#
# Four filters on one recording: the right one, and three that are wrong about one thing each.

import numpy as np

import backsight as bs
from backsight import plot

plant = bs.sdof(k=40.0, b=0.8, c=1.0)
rng = np.random.default_rng(1)
SAMPLES, DT, SIGMA_Y, SIGMA_V = 2000, 0.02, 1e-3, 0.01
Q_FACTOR = SIGMA_V / DT  # a force that is held for a sample adds this to the speed
forced = bs.lti(
    [[0, 1], [-40, -0.8]],
    [[0, 0], [1, 1]],
    [[1, 0]],
    states={"q": "m", "v": "m/s"},
    inputs={"u": "N", "w": "N"},  # on a mass of 1 kg
    outputs={"y": "m"},
)
push = np.sign(np.sin(0.03 * np.arange(SAMPLES)))
inputs = np.column_stack([push, Q_FACTOR * rng.standard_normal(SAMPLES)])
recording = bs.simulate(forced, inputs, dt=DT, sigma_y=SIGMA_Y, seed=2).sel(input=["u"])
recording = recording.assign_coords(input=["u"])
prior = bs.Prior(sigma_x0=1.0)
stiffer = bs.sdof(k=52.0, b=0.8, c=1.0)


def filtered(model, sigma_y, sigma_v):
    """Result of a Kalman filter that believes in these."""
    noise = bs.Noise(sigma_y=sigma_y, sigma_w={"v": sigma_v})
    return bs.estimate(bs.KalmanFilter(noise, prior), model, recording)


results = {
    "right": filtered(plant, SIGMA_Y, SIGMA_V),
    "R / 9": filtered(plant, SIGMA_Y / 3, SIGMA_V),
    "Q / 9": filtered(plant, SIGMA_Y, SIGMA_V / 3),
    "stiffness + 30 %": filtered(stiffer, SIGMA_Y, SIGMA_V),
}
for name, result in results.items():
    low, high = bs.check.nis_band(result)
    lag = float(bs.check.autocorrelation(result).correlation.sel(lag=1, output="y"))
    print(
        f"{name:17} mean NIS {bs.check.mean_nis(result):5.2f} ({low:.2f} to {high:.2f})   "
        f"correlation {lag:+.2f}"
    )

# %%
# Size alone does not tell them apart, sign does: **too small an R** follows noise and must come back (negative), **too small a Q**
# lags behind (positive), and a **wrong model** is wrong in the direction in which it was pushed.

plot.draw_spectrum({name: results[name] for name in ("right", "R / 9", "stiffness + 30 %")})

# %%
# The right one is flat. The stiffness leaves a peak at the frequency that the model does not have.

# %%
# What the verdict does with it
# -----------------------------
# The autocovariance of the innovations is linear in the factors of R and Q that would be right (Mehra 1970); least squares finds them.

believing = {"R / 9": (SIGMA_Y / 3, SIGMA_V), "Q / 9": (SIGMA_Y, SIGMA_V / 3)}
filters = {
    name: bs.KalmanFilter(bs.Noise(sigma_y=of_y, sigma_w={"v": of_v}), prior)
    for name, (of_y, of_v) in believing.items()
}
for sentence in bs.compare(filters, plant, recording).verdicts()[-2:]:
    print(sentence)

# %%
# Exercises
# ---------
# **1.** Multiply R and Q by 4. Which numbers change, which do not, and why?
#
# **2.** NEES measures the error with its own covariance and needs the truth. Compute it for the right filter and for Q / 9; which of the
# two lies?
#
# **3.** Can innovations be perfect and the estimate wrong?

# %%
# Solutions
# ---------
# **1.** The gain depends on the ratio of Q and R alone, and with it the estimate and the correlation. The NIS is divided by four:

both = filtered(plant, 2 * SIGMA_Y, 2 * SIGMA_V)
print(
    f"mean NIS {bs.check.mean_nis(both):.2f} instead of {bs.check.mean_nis(results['right']):.2f};"
)
print(f"estimates differ by {float(np.abs(both.x_hat - results['right'].x_hat)[50:].max()):.1e}")

# %%
# **2.** The recording knows its truth, for it is simulated:


def nees(result):
    """Mean of the squared errors, measured with the covariance."""
    error = result.x_hat.values - recording.x_true.values
    return np.mean(np.einsum("ki,kij,kj->k", error, np.linalg.inv(result.P.values), error)[50:])


for name in ("right", "Q / 9"):
    print(f"{name:6} mean NEES {nees(results[name]):.2f}, expected 2")

# %%
# **3.** Yes: what no sensor sees leaves no trace in the innovations. Add a mass that nothing connects to the sensors, or a parameter with
# its prior in the wrong place: the innovations are white, and the band of that state is what you wrote into the prior. Ask
# :doc:`observability </chapters/c1_observability>` first.
#
# **Read on.** Mehra, *On the identification of variances and adaptive Kalman filtering*, 1970, doi:10.1109/TAC.1970.1099422.
# Bar-Shalom, Li, Kirubarajan, *Estimation with Applications to Tracking and Navigation*, 2001, section 5.4.

"""
Is it observable? Ask before you measure
========================================

Which states and parameters a set of sensors can show follows from the model alone. It is cheaper to know that before the
sensors are bought.
"""

# %%
import numpy as np

import backsight as bs
from backsight import plot

two = bs.lti(
    [[0, 0, 1, 0], [0, 0, 0, 1], [-150, 50, -0.5, 0], [100, -100, 0, -0.2]],
    [[0], [0], [0.5], [0]],
    [[1, 0, 0, 0]],
    states={"x1": "m", "x2": "m", "v1": "m/s", "v2": "m/s"},
    inputs={"F": "N"},
    outputs={"y": "m"},
)
print(bs.check.check_observability(two))

# %%
# The same two masses without a spring to the wall between them and the sensor: nothing tells of the second one.

loose = bs.lti(
    [[0, 0, 1, 0], [0, 0, 0, 1], [-100, 0, -0.5, 0], [100, -100, 0, -0.2]],
    [[0], [0], [0.5], [0]],
    [[1, 0, 0, 0]],
    states={"x1": "m", "x2": "m", "v1": "m/s", "v2": "m/s"},
    inputs={"F": "N"},
    outputs={"y": "m"},
)
print(bs.check.check_observability(loose))

# %%
# The filter says the same by its bands: where they never become smaller, nothing is seen.

force = np.sign(np.sin(0.1 * np.arange(400)))[:, None]
noise = bs.Noise(sigma_y=1e-4, sigma_w={"v1": 1e-4, "v2": 1e-4})
kalman = bs.KalmanFilter(noise, bs.Prior(sigma_x0=0.02))
seen = {
    name: bs.estimate(kalman, model, bs.simulate(model, force, dt=0.02, sigma_y=1e-4, seed=1))
    for name, model in {"coupled": two, "loose": loose}.items()
}
plot.draw_states(seen, ["x2"])

# %%
# Parameters: it depends on the motion
# ------------------------------------
# Stiffness and damping beside the states make a model that is not linear; the question is then asked along a motion. At
# rest nothing can be told, under a force that changes everything can.

joint = bs.augment(bs.sdof(k=40.0, b=0.8, c=1.0), parameters=["k", "b"])
for name, force in {
    "at rest": np.zeros((200, 1)),
    "pushed": np.sign(np.sin(0.1 * np.arange(200)))[:, None],
}.items():
    print(name)
    print(bs.check.check_observability_along(joint, force, dt=0.02))

"""Problem files: a recording, a model, what is unknown, and estimators, without any Python.

A problem file is TOML. Its tables, with everything that may be left out in brackets::

    title = "..."                 # [heading of the report]

    [recording]
    path = "drive.csv"            # relative to this file; ${BACKSIGHT_DATA}: that folder
    source = "..."                # [where to get it, told when it is missing]
    time = "t_s"                  # column of time [s]; or dt = 1e-3
    inputs.F = { column = "F_N", unit = "N" }       # [factor, offset, delay, remove_mean;
                                  # gaps = { walk, sigma, sigma_u }: not known at every sample]
    outputs.y = { column = "q_m", unit = "m" }      # [of angles wrap = 360 or "2*pi"; resolution]
                                  # [truth.STATE; sigma_factor.OUTPUT: noise of single samples;
                                  # formulas.NAME: arithmetic on columns; high_pass [Hz];
                                  # start, stop, resample, grid [s]; format, axis, time_format,
                                  # missing, delimiter, decimal, thousands, encoding, header,
                                  # skip_lines]
    [recording.parts]             # [larger than memory: read and estimated part by part]
    samples = 1_000_000           # [variables, every, dtype: what is kept]

    [recording.sources.camera]    # [a further file, with all keys of [recording]]
    path = "camera.csv"
    delay = 0.012                 # [s by which its clock is late]
    outputs.z = "z_m"

    [model]
    kind = "friction_drive"       # with its arguments; or "equations", "lti", "second_order",
                                  # "beam", "modal", "reduced"

    [estimate]                    # parameters that are not known
    M = { start = 70.0, sigma = 30.0 }              # [walk, lower, upper, scale, unit]

    [disturbances]                # [unknown quantities added to the rate of a state]
    w = { acts_on = "v", sigma = 1e5, walk = 1e4 }  # [start, lower, upper, scale, unit]

    [virtual]                     # [quantities where no sensor is]
    tip = { kind = "displacement", at = 0.4 }       # of a structure, like a sensor
    force = { expression = "k*q", unit = "N" }      # or a formula: states, inputs, parameters,
                                                    # outputs, rates (v_dot), virtual ones above

    [dummy]                       # [displacements that stay near zero, see docs/virtual-sensors]
    stays = { kind = "displacement", at = 0.4, sigma = 1e-2 }   # or a formula, as in [virtual]

    [noise]
    sigma_y = { y = 1e-6 }        # of the measurement; or R
    sigma_w = { v = 1e-4 }        # [random step per sample; or Q per sample, Qc per second]
    sigma_u = { F = 0.1 }         # [of inputs that are measured; sigma_p of parameters, cross]
    outliers = { kind = "Gate" }  # [or "StudentT", "Huber"; with their settings]

    [prior]
    sigma_x0 = { q = 0.1, v = 0.1 }                 # or P0
    x0 = { q = 0.0 }              # [0 if not given]

    [integrator]                  # [scheme, substeps, hold]
    substeps = 2

    [estimators.MHO]              # a name of your own
    kind = "mho"                  # `backsight methods` lists the kinds and their settings
    N = 15                        # [settings; integrator, noise, prior of its own; smooth = true;
                                  # of sparse forces: search = {...} or follow = {...}]

    [reference]                   # [known values, for errors]
    M = 95.1

    [tune]                        # [what `backsight tune` finds]
    free = ["sigma_y", "sigma_w"] # [or { name, spread, sigma, per, options }]
    estimator = "EKF"             # [the first that can if not given]
    criterion = { kind = "Likelihood" }             # [or "Prediction", "MultiStep", "Whiteness"]
    recordings = ["second.csv"]   # [further ones, with the same columns]

    [output]
    report = true                 # [whether to write the page]
"""

import importlib
from typing import TYPE_CHECKING, Any

from backsight.problem.problem import Problem as Problem
from backsight.problem.reading.loading import load as load

if TYPE_CHECKING:
    from backsight.problem.running import run_problem as run_problem
    from backsight.problem.tuning import tune_problem as tune_problem

_LATER = {"run_problem": "running", "tune_problem": "tuning"}
"""What few of those who read a problem need, and what takes a quarter of a second to import."""


def __getattr__(name: str) -> Any:
    if name not in _LATER:
        raise AttributeError(f"module '{__name__}' has no attribute '{name}'", name=name)
    return getattr(importlib.import_module(f"{__name__}.{_LATER[name]}"), name)

"""Estimate states, parameters and unknown forces of machines from a model and measurements.

The public names are imported when they are used first, so that the command line and programs that
need a few of them start at once. The table says where each of them lives; the imports above it say
the same to type checkers and editors.
"""

import importlib
from typing import TYPE_CHECKING

# The function must hide the folder of the same name, which it does if it is bound after it.
from backsight.report import report as report

if TYPE_CHECKING:
    from backsight import errors as errors
    from backsight.analysis.consistency import consistency as consistency
    from backsight.analysis.forces import force_errors as force_errors
    from backsight.analysis.forces import impacts as impacts
    from backsight.analysis.observability import force_locations as force_locations
    from backsight.analysis.observability import observability as observability
    from backsight.data import from_arrays as from_arrays
    from backsight.data import merge as merge
    from backsight.data import read as read
    from backsight.data import resample as resample
    from backsight.data.increments import increments as increments
    from backsight.discrete.runge_kutta import Integrator as Integrator
    from backsight.estimators import AHG as AHG
    from backsight.estimators import EKF as EKF
    from backsight.estimators import ESTIMATORS as ESTIMATORS
    from backsight.estimators import HGO as HGO
    from backsight.estimators import IEKF as IEKF
    from backsight.estimators import MHE as MHE
    from backsight.estimators import MHO as MHO
    from backsight.estimators import UKF as UKF
    from backsight.estimators import CompressiveSensingMHE as CompressiveSensingMHE
    from backsight.estimators import JointInput as JointInput
    from backsight.estimators import KalmanFilter as KalmanFilter
    from backsight.estimators import Limit as Limit
    from backsight.estimators import LinearMHE as LinearMHE
    from backsight.estimators import Luenberger as Luenberger
    from backsight.estimators import Noise as Noise
    from backsight.estimators import Prior as Prior
    from backsight.estimators import RecursiveMHE as RecursiveMHE
    from backsight.estimators.cs_mhe import Atoms as Atoms
    from backsight.estimators.cs_mhe import Carryover as Carryover
    from backsight.estimators.cs_mhe import HalfSines as HalfSines
    from backsight.estimators.cs_mhe import Impulses as Impulses
    from backsight.estimators.mhe import ConstantArrival as ConstantArrival
    from backsight.estimators.mhe import EKFArrival as EKFArrival
    from backsight.estimators.mhe import NoArrival as NoArrival
    from backsight.estimators.mhe import SmoothedArrival as SmoothedArrival
    from backsight.estimators.mhe import UKFArrival as UKFArrival
    from backsight.estimators.observers import AdaptiveGain as AdaptiveGain
    from backsight.models import Model as Model
    from backsight.models import Signal as Signal
    from backsight.models import augment as augment
    from backsight.models import beam as beam
    from backsight.models import duffing as duffing
    from backsight.models import friction_drive as friction_drive
    from backsight.models import from_equations as from_equations
    from backsight.models import lti as lti
    from backsight.models import modal as modal
    from backsight.models import reduced as reduced
    from backsight.models import scale as scale
    from backsight.models import sdof as sdof
    from backsight.models import second_order as second_order
    from backsight.models.incremental import incremental as incremental
    from backsight.models.sampling import check_sampling as check_sampling
    from backsight.models.sensor_lag import sensor_lag as sensor_lag
    from backsight.models.unknown_forces import forces_as_inputs as forces_as_inputs
    from backsight.run.compare import compare as compare
    from backsight.run.diagnosis import alignment as alignment
    from backsight.run.diagnosis import certify as certify
    from backsight.run.estimation import estimate as estimate
    from backsight.run.estimation import estimate_many as estimate_many
    from backsight.run.estimation import stream as stream
    from backsight.run.estimation import window as window
    from backsight.run.simulation import simulate as simulate
    from backsight.run.sparse_forces import sparse_forces as sparse_forces
    from backsight.solvers.box import GaussNewton as GaussNewton
    from backsight.sparse import L1 as L1
    from backsight.sparse import Given as Given
    from backsight.sparse import Greedy as Greedy
    from backsight.sparse import Reweighted as Reweighted
    from backsight.tune._force_path import force_path as force_path
    from backsight.tune._recovery import Hits as Hits
    from backsight.tune._recovery import recovery as recovery
    from backsight.tune.calibration import calibrate as calibrate
    from backsight.tune.lambda_choice import lambda_from_noise as lambda_from_noise
    from backsight.tune.lambda_choice import lambda_from_sensors as lambda_from_sensors
    from backsight.tune.lambda_choice import lambda_from_whiteness as lambda_from_whiteness
    from backsight.tune.placement import place_sensors as place_sensors
    from backsight.tune.sparsity import lambda_max as lambda_max

    __version__: str

_NAMES = {
    "analysis.consistency": "consistency",
    "analysis.forces": "force_errors impacts",
    "analysis.observability": "force_locations observability",
    "data": "from_arrays merge read resample",
    "data.increments": "increments",
    "discrete.runge_kutta": "Integrator",
    "estimators": (
        "AHG CompressiveSensingMHE EKF ESTIMATORS HGO IEKF JointInput KalmanFilter Limit "
        "LinearMHE Luenberger MHE MHO Noise Prior RecursiveMHE UKF"
    ),
    "estimators.cs_mhe": "Atoms Carryover HalfSines Impulses",
    "estimators.mhe": "ConstantArrival EKFArrival NoArrival SmoothedArrival UKFArrival",
    "estimators.observers": "AdaptiveGain",
    "models": (
        "Model Signal augment beam duffing friction_drive from_equations lti modal reduced "
        "scale sdof second_order"
    ),
    "models.incremental": "incremental",
    "models.sampling": "check_sampling",
    "models.sensor_lag": "sensor_lag",
    "models.unknown_forces": "forces_as_inputs",
    "run.compare": "compare",
    "run.diagnosis": "alignment certify",
    "run.estimation": "estimate estimate_many stream window",
    "run.simulation": "simulate",
    "run.sparse_forces": "sparse_forces",
    "solvers.box": "GaussNewton",
    "sparse": "Given Greedy L1 Reweighted",
    "tune.calibration": "calibrate",
    "tune._force_path": "force_path",
    "tune.lambda_choice": "lambda_from_noise lambda_from_sensors lambda_from_whiteness",
    "tune.placement": "place_sensors",
    "tune._recovery": "Hits recovery",
    "tune.sparsity": "lambda_max",
}
_HOMES = {name: home for home, names in _NAMES.items() for name in names.split()}


def __getattr__(name: str) -> object:
    if name == "__version__":
        found: object = importlib.import_module("importlib.metadata").version(__name__)
    elif name in ("errors", "extend", "testing"):
        found = importlib.import_module(f"{__name__}.{name}")
    elif name in _HOMES:
        found = getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
    else:
        raise AttributeError(f"module '{__name__}' has no attribute '{name}'", name=name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES, "errors", "__version__"})

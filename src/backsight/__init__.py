"""Estimate states, parameters and unknown forces of machines from a model and measurements."""

from importlib.metadata import version as _version

from backsight import errors as errors
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
from backsight.estimators import MHO as MHO
from backsight.estimators import UKF as UKF
from backsight.estimators import KalmanFilter as KalmanFilter
from backsight.estimators import Limit as Limit
from backsight.estimators import LinearMHE as LinearMHE
from backsight.estimators import Luenberger as Luenberger
from backsight.estimators import Noise as Noise
from backsight.estimators import Prior as Prior
from backsight.estimators import RecursiveMHE as RecursiveMHE
from backsight.estimators.adaptive_gain import AdaptiveGain as AdaptiveGain
from backsight.models import Model as Model
from backsight.models import Signal as Signal
from backsight.models import augment as augment
from backsight.models import duffing as duffing
from backsight.models import friction_drive as friction_drive
from backsight.models import from_equations as from_equations
from backsight.models import lti as lti
from backsight.models import scale as scale
from backsight.models import sdof as sdof
from backsight.models import second_order as second_order
from backsight.models.incremental import incremental as incremental
from backsight.report import report as report
from backsight.run.compare import compare as compare
from backsight.run.estimate import estimate as estimate
from backsight.run.many import estimate_many as estimate_many
from backsight.run.simulate import simulate as simulate
from backsight.run.stream import stream as stream
from backsight.solvers.gauss_newton import GaussNewton as GaussNewton

__version__ = _version("backsight")

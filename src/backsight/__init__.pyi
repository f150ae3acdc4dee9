"""The public names: the table that `backsight` reads when one of them is used first.

Type checkers and editors read it, too. A line is ``from MODULE import NAME as NAME``.
"""

from backsight import check as check
from backsight import data as data
from backsight import errors as errors
from backsight import export as export
from backsight import extend as extend
from backsight import fleet as fleet
from backsight import forces as forces
from backsight import large as large
from backsight import models as models
from backsight import plot as plot
from backsight import settings as settings
from backsight import signals as signals
from backsight import testing as testing
from backsight import tune as tune
from backsight.data import from_arrays as from_arrays
from backsight.data import merge as merge
from backsight.data import read as read
from backsight.data import resample as resample
from backsight.discrete.runge_kutta import Integrator as Integrator
from backsight.estimators import AHG as AHG
from backsight.estimators import EKF as EKF
from backsight.estimators import HGO as HGO
from backsight.estimators import IEKF as IEKF
from backsight.estimators import MHE as MHE
from backsight.estimators import MHO as MHO
from backsight.estimators import UKF as UKF
from backsight.estimators import CompressiveSensingMHE as CompressiveSensingMHE
from backsight.estimators import JointInput as JointInput
from backsight.estimators import KalmanFilter as KalmanFilter
from backsight.estimators import LinearMHE as LinearMHE
from backsight.estimators import Luenberger as Luenberger
from backsight.estimators import Noise as Noise
from backsight.estimators import Prior as Prior
from backsight.estimators import RecursiveMHE as RecursiveMHE
from backsight.models import Model as Model
from backsight.models import Signal as Signal
from backsight.models import augment as augment
from backsight.models import beam as beam
from backsight.models import craig_bampton as craig_bampton
from backsight.models import duffing as duffing
from backsight.models import friction_drive as friction_drive
from backsight.models import from_equations as from_equations
from backsight.models import lti as lti
from backsight.models import modal as modal
from backsight.models import reduced as reduced
from backsight.models import sdof as sdof
from backsight.models import second_order as second_order
from backsight.models import with_virtual as with_virtual
from backsight.report import report as report
from backsight.run.compare import compare as compare
from backsight.run.estimation import estimate as estimate
from backsight.run.estimation import estimate_many as estimate_many
from backsight.run.estimation import smooth as smooth
from backsight.run.estimation import solve_window as solve_window
from backsight.run.estimation import stream as stream
from backsight.run.simulation import simulate as simulate
from backsight.run.simulation import simulate_closed_loop as simulate_closed_loop

__version__: str

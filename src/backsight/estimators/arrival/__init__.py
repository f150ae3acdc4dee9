"""Arrival costs, for every estimator with a window that has the field ``arrival``."""

from backsight.estimators.arrival._base import AbstractArrival as AbstractArrival
from backsight.estimators.arrival._base import Arrival as Arrival
from backsight.estimators.arrival._base import Fitting as Fitting
from backsight.estimators.arrival._base import Leaving as Leaving
from backsight.estimators.arrival._costs import ARRIVALS as ARRIVALS
from backsight.estimators.arrival._costs import ConstantArrival as ConstantArrival
from backsight.estimators.arrival._costs import EKFArrival as EKFArrival
from backsight.estimators.arrival._costs import NoArrival as NoArrival
from backsight.estimators.arrival._costs import SmoothedArrival as SmoothedArrival
from backsight.estimators.arrival._costs import UKFArrival as UKFArrival
from backsight.estimators.arrival._costs import arrival_name as arrival_name

"""High-gain observers with fixed and adaptive gain."""

from backsight.estimators.observers.adaptive_gain import AdaptiveGain as AdaptiveGain
from backsight.estimators.observers.ahg import AHG as AHG
from backsight.estimators.observers.hgo import HGO as HGO

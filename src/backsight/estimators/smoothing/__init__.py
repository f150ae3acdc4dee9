"""Fixed-interval smoothing: a filter forward, an information filter back."""

from backsight.estimators.smoothing._backward import Linearised as Linearised
from backsight.estimators.smoothing._equations import NOTHING as NOTHING
from backsight.estimators.smoothing._equations import FlatForce as FlatForce
from backsight.estimators.smoothing._equations import estimated as estimated
from backsight.estimators.smoothing._equations import joined as joined
from backsight.estimators.smoothing._equations import joined_with_force as joined_with_force
from backsight.estimators.smoothing._equations import known_by as known_by
from backsight.estimators.smoothing._equations import of_size_one as of_size_one
from backsight.estimators.smoothing._equations import through_noise as through_noise
from backsight.estimators.smoothing._equations import turned as turned
from backsight.estimators.smoothing._equations import without_force as without_force
from backsight.estimators.smoothing._passes import filter_channels as filter_channels
from backsight.estimators.smoothing._passes import leaving as leaving
from backsight.estimators.smoothing._passes import passes as passes
from backsight.estimators.smoothing._passes import smoothed_channels as smoothed_channels
from backsight.estimators.smoothing.information import drowned as drowned
from backsight.estimators.smoothing.two_filter import blurred as blurred
from backsight.estimators.smoothing.two_filter import combined as combined
from backsight.estimators.smoothing.two_filter import gathered as gathered
from backsight.estimators.smoothing.two_filter import weakened as weakened

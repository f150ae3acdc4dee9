"""Windows of many states: covariances are whole matrices, and formulas operations on matrices.

The outputs of a sample are taken in at once. Their record holds the gain K of all of them, and in
the place of one over the variance of each the lower factor of the covariance S of the innovations.
"""

from backsight.solvers.trajectory.many_states._backward import backward as backward
from backsight.solvers.trajectory.many_states._forward import transit as transit
from backsight.solvers.trajectory.many_states._forward import update as update
from backsight.solvers.trajectory.many_states._information import information as information
from backsight.solvers.trajectory.many_states._information import reduced as reduced
from backsight.solvers.trajectory.many_states._merit import merit_of_sample as merit_of_sample
from backsight.solvers.trajectory.many_states._mistaken import beside as beside
from backsight.solvers.trajectory.many_states._mistaken import newest as newest

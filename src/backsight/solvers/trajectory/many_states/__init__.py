"""Windows of many states: covariances are whole matrices, and formulas operations on matrices.

The outputs of a sample are taken in at once. Their record holds the gain K of all of them, and in
the place of one over the variance of each the lower factor of the covariance S of the innovations.
"""

from backsight.solvers.trajectory.many_states._backward import backward_of_many as backward_of_many
from backsight.solvers.trajectory.many_states._forward import transit_of_many as transit_of_many
from backsight.solvers.trajectory.many_states._forward import update_of_many as update_of_many
from backsight.solvers.trajectory.many_states._information import (
    information_of_many as information_of_many,
)
from backsight.solvers.trajectory.many_states._information import reduced_of_many as reduced_of_many
from backsight.solvers.trajectory.many_states._merit import inner as inner
from backsight.solvers.trajectory.many_states._merit import merit_of_many as merit_of_many
from backsight.solvers.trajectory.many_states._merit import times_stored as times_stored
from backsight.solvers.trajectory.many_states._mistaken import beside_of_many as beside_of_many
from backsight.solvers.trajectory.many_states._mistaken import newest_of_many as newest_of_many

"""Search for sparse forces over a whole recording, in NumPy."""

from backsight.sparse._force_search import ForceSearch as ForceSearch
from backsight.sparse._force_search import force_search as force_search
from backsight.sparse._l1_path import L1Path as L1Path
from backsight.sparse._l1_path import l1_path as l1_path
from backsight.sparse._matrices import MatricesInTime as MatricesInTime
from backsight.sparse._matrices import free_motion as free_motion
from backsight.sparse._matrices import matrices_along as matrices_along
from backsight.sparse.regression import Fit as Fit
from backsight.sparse.regression import Regression as Regression
from backsight.sparse.regression import refit as refit
from backsight.sparse.selection import L1 as L1
from backsight.sparse.selection import AbstractSelection as AbstractSelection
from backsight.sparse.selection import Given as Given
from backsight.sparse.selection import Greedy as Greedy
from backsight.sparse.selection import GreedyGroups as GreedyGroups
from backsight.sparse.selection import Reweighted as Reweighted

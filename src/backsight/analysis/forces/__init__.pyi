"""Estimated forces beside applied ones: impacts, hits, errors."""

from backsight.analysis.forces._announced import Announcement as Announcement
from backsight.analysis.forces._announced import HitWatch as HitWatch
from backsight.analysis.forces._announced import announce_hits as announce_hits
from backsight.analysis.forces._fitted_hits import FittedHit as FittedHit
from backsight.analysis.forces._fitted_hits import fitted_hits as fitted_hits
from backsight.analysis.forces._fitted_hits import largest_of as largest_of
from backsight.analysis.forces._fitted_hits import with_fitted_hits as with_fitted_hits
from backsight.analysis.forces._force_errors import ForceErrors as ForceErrors
from backsight.analysis.forces._force_errors import compare_forces as compare_forces
from backsight.analysis.forces._force_remarks import REMARKS as REMARKS
from backsight.analysis.forces._force_remarks import force_remarks as force_remarks
from backsight.analysis.forces._hits import FoundHits as FoundHits
from backsight.analysis.forces._hits import forces as forces
from backsight.analysis.forces._hits import hits as hits
from backsight.analysis.forces._hits import where as where
from backsight.analysis.forces._impacts import Impact as Impact
from backsight.analysis.forces._impacts import find_impacts as find_impacts
from backsight.analysis.forces._impacts import matches as matches

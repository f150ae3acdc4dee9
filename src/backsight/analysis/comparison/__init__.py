"""Several results beside each other: errors, summary, verdict."""

from backsight.analysis.comparison._summary import ALIGNED as ALIGNED
from backsight.analysis.comparison._summary import ALIGNMENT as ALIGNMENT
from backsight.analysis.comparison._summary import DOUBTS as DOUBTS
from backsight.analysis.comparison._summary import failed as failed
from backsight.analysis.comparison._summary import ranked_table as ranked_table
from backsight.analysis.comparison._summary import summary as summary
from backsight.analysis.comparison._summary import units as units
from backsight.analysis.comparison.error_measures import convergence_time as convergence_time
from backsight.analysis.comparison.error_measures import rmse as rmse
from backsight.analysis.comparison.error_measures import rse as rse
from backsight.analysis.comparison.row import Final as Final
from backsight.analysis.comparison.row import Row as Row
from backsight.analysis.comparison.verdict import Light as Light
from backsight.analysis.comparison.verdict import light as light
from backsight.analysis.comparison.verdict import ranking_sentence as ranking_sentence
from backsight.analysis.comparison.verdict import sentence as sentence
from backsight.analysis.comparison.verdict import verdicts as verdicts
from backsight.analysis.comparison.virtual_outputs import VirtualOutput as VirtualOutput

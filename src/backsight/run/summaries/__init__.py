"""What estimators say of many recordings, without their results: accumulated while they run."""

from backsight.run.summaries._estimate_summaries import estimate_summaries as estimate_summaries
from backsight.run.summaries._estimate_summaries import summed_up as summed_up
from backsight.run.summaries._totals import USED as USED
from backsight.run.summaries._totals import Totals as Totals
from backsight.run.summaries._totals import largest as largest
from backsight.run.summaries._totals import totalling as totalling

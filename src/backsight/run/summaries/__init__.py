"""What estimators say of many recordings, without their results: accumulated while they run."""

from backsight.run.summaries._estimate_summaries import estimate_summaries as estimate_summaries

"""Questions about a recording and an estimator that need further runs."""

from backsight.run.diagnosis.alignment import alignment as alignment
from backsight.run.diagnosis.audit import aligned as aligned
from backsight.run.diagnosis.audit import audited as audited
from backsight.run.diagnosis.certify import certify as certify

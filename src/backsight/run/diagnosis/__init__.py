"""Questions about a recording and an estimator that need further runs."""

from backsight.run.diagnosis._certify import certify as certify
from backsight.run.diagnosis._delays import check_alignment as check_alignment
from backsight.run.diagnosis._identifiability import (
    check_identifiability as check_identifiability,
)
from backsight.run.diagnosis._profile import profile as profile
from backsight.run.diagnosis._sense import poles as poles
from backsight.run.diagnosis.audit import aligned as aligned
from backsight.run.diagnosis.audit import audited as audited
from backsight.run.diagnosis.audit import expected as expected

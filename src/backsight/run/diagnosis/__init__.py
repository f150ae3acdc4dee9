"""Questions about a recording and an estimator that need further runs."""

from backsight.run.diagnosis._certify import certify as certify
from backsight.run.diagnosis._readings import clipped_readings as clipped_readings
from backsight.run.diagnosis._readings import coarse_readings as coarse_readings
from backsight.run.diagnosis._readings import rounded_readings as rounded_readings
from backsight.run.diagnosis._readings import saturated_readings as saturated_readings
from backsight.run.diagnosis._readings import turned_readings as turned_readings
from backsight.run.diagnosis.audit import aligned as aligned
from backsight.run.diagnosis.audit import audited as audited
from backsight.run.diagnosis.audit import expected as expected
from backsight.run.diagnosis.delays import check_alignment as check_alignment
from backsight.run.diagnosis.parameters.identifiability import (
    check_identifiability as check_identifiability,
)
from backsight.run.diagnosis.parameters.profile import profile as profile
from backsight.run.diagnosis.parameters.sense import poles as poles

"""Whether a recording can show what is asked for, and whether an estimate is what it promises."""

from backsight.analysis.certificate import Certificate as Certificate
from backsight.analysis.consistency import Consistency as Consistency
from backsight.analysis.consistency import NoiseFactors as NoiseFactors
from backsight.analysis.consistency import autocorrelation as autocorrelation
from backsight.analysis.consistency import consistency as consistency
from backsight.analysis.consistency import coverage as coverage
from backsight.analysis.consistency import log_likelihood as log_likelihood
from backsight.analysis.consistency import mean_nis as mean_nis
from backsight.analysis.consistency import nis as nis
from backsight.analysis.consistency import nis_band as nis_band
from backsight.analysis.consistency import noise_factors as noise_factors
from backsight.analysis.consistency import windowed_nis as windowed_nis
from backsight.analysis.observability import Observability as Observability
from backsight.analysis.observability import force_locations as force_locations
from backsight.analysis.observability import observability as observability
from backsight.analysis.observability import observability_along as observability_along
from backsight.analysis.observability import transmission_zeros as transmission_zeros
from backsight.analysis.recording import Alignment as Alignment
from backsight.models.sampling import check_sampling as check_sampling
from backsight.run.diagnosis import alignment as alignment
from backsight.run.diagnosis import certify as certify

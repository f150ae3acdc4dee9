"""Whether a recording can show what is asked for, and whether an estimate is what it promises."""

from backsight.analysis.alignment import Alignment as Alignment
from backsight.analysis.certificate import Certificate as Certificate
from backsight.analysis.consistency import Consistency as Consistency
from backsight.analysis.consistency import NoiseFactors as NoiseFactors
from backsight.analysis.consistency import autocorrelation as autocorrelation
from backsight.analysis.consistency import check_consistency as check_consistency
from backsight.analysis.consistency import coverage as coverage
from backsight.analysis.consistency import log_likelihood as log_likelihood
from backsight.analysis.consistency import mean_nis as mean_nis
from backsight.analysis.consistency import nis as nis
from backsight.analysis.consistency import nis_band as nis_band
from backsight.analysis.consistency import noise_factors as noise_factors
from backsight.analysis.consistency import windowed_nis as windowed_nis
from backsight.analysis.observability import Identifiability as Identifiability
from backsight.analysis.observability import Observability as Observability
from backsight.analysis.observability import check_force_locations as check_force_locations
from backsight.analysis.observability import check_observability as check_observability
from backsight.analysis.observability import check_observability_along as check_observability_along
from backsight.analysis.observability import transmission_zeros as transmission_zeros
from backsight.analysis.outliers import Outliers as Outliers
from backsight.analysis.outliers import outliers as outliers
from backsight.models.sampling import check_sampling as check_sampling
from backsight.run.diagnosis import certify as certify
from backsight.run.diagnosis import check_alignment as check_alignment
from backsight.run.diagnosis import check_identifiability as check_identifiability
from backsight.run.diagnosis import profile as profile

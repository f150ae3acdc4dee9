"""Whether innovations and errors are what the covariances promise."""

from backsight.analysis.consistency._causes import cause as cause
from backsight.analysis.consistency._causes import pattern as pattern
from backsight.analysis.consistency._consistency import NOISE_FACTORS as NOISE_FACTORS
from backsight.analysis.consistency._consistency import Consistency as Consistency
from backsight.analysis.consistency._consistency import check_consistency as check_consistency
from backsight.analysis.consistency._coverage import coverage as coverage
from backsight.analysis.consistency._coverage import shares_within as shares_within
from backsight.analysis.consistency._nis import log_likelihood as log_likelihood
from backsight.analysis.consistency._nis import mean_nis as mean_nis
from backsight.analysis.consistency._nis import measured_channels as measured_channels
from backsight.analysis.consistency._nis import nis as nis
from backsight.analysis.consistency._nis import nis_band as nis_band
from backsight.analysis.consistency._nis import windowed_nis as windowed_nis
from backsight.analysis.consistency._noise_factors import FilterPath as FilterPath
from backsight.analysis.consistency._noise_factors import NoiseFactors as NoiseFactors
from backsight.analysis.consistency._noise_factors import filter_gains as filter_gains
from backsight.analysis.consistency._noise_factors import noise_factors as noise_factors
from backsight.analysis.consistency.spectrum import innovation_spectrum as innovation_spectrum
from backsight.analysis.consistency.whiteness import autocorrelation as autocorrelation
from backsight.analysis.consistency.whiteness import normalised as normalised

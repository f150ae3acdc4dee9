"""What authors of an extension need: the parts that our own estimators, models and readers use.

An estimator is a frozen dataclass derived from `AbstractEstimator`; `setting` checks and scales,
`assemble` makes a `Recursion` of a measurement update and a time update (`Halves`), whose formulas
are written with `half` and `leaf`; other recursions keep a `Memory`. Loops are `scan` and
`iterate`. `backsight.testing.check_estimator` says whether it keeps its promises.
"""

from backsight.algebra.symmetric import unvech as unvech
from backsight.algebra.symmetric import vech as vech
from backsight.algebra.update import masked as masked
from backsight.algebra.update import measured as measured
from backsight.algebra.update import noise_of as noise_of
from backsight.data.formats.loading import READERS as READERS
from backsight.engine.loops import iterate as iterate
from backsight.engine.loops import scan as scan
from backsight.engine.recursion import Channel as Channel
from backsight.engine.recursion import Recursion as Recursion
from backsight.estimators import ALL_ESTIMATORS as ALL_ESTIMATORS
from backsight.estimators import ESTIMATORS as ESTIMATORS
from backsight.estimators.base import ESTIMATE_CHANNELS as ESTIMATE_CHANNELS
from backsight.estimators.base import AbstractEstimator as AbstractEstimator
from backsight.estimators.kalman.ekf import correct as correct
from backsight.estimators.kalman.ekf import ekf_halves as ekf_halves
from backsight.estimators.kalman.ekf import innovation as innovation
from backsight.estimators.kalman.ekf import updated as updated
from backsight.estimators.kalman.prediction import predict as predict
from backsight.estimators.parts.covariance import Covariance as Covariance
from backsight.estimators.parts.covariance import congruence as congruence
from backsight.estimators.parts.covariance import joseph_form as joseph_form
from backsight.estimators.parts.covariance import kalman_gain as kalman_gain
from backsight.estimators.parts.covariance import packed as packed
from backsight.estimators.parts.covariance import times_transposed as times_transposed
from backsight.estimators.parts.factors import cholesky as cholesky
from backsight.estimators.parts.factors import definite as definite
from backsight.estimators.parts.factors import solve_definite as solve_definite
from backsight.estimators.parts.filtering import Halves as Halves
from backsight.estimators.parts.filtering import assemble as assemble
from backsight.estimators.parts.filtering import choose as choose
from backsight.estimators.parts.filtering import data_inputs as data_inputs
from backsight.estimators.parts.filtering import physical as physical
from backsight.estimators.parts.flags import Flags as Flags
from backsight.estimators.parts.leaf import Symmetric as Symmetric
from backsight.estimators.parts.leaf import half as half
from backsight.estimators.parts.leaf import leaf as leaf
from backsight.estimators.parts.leaf import named_results as named_results
from backsight.estimators.parts.leaf import notation as notation
from backsight.estimators.parts.memory import Memory as Memory
from backsight.estimators.parts.substeps import within_bounds as within_bounds
from backsight.estimators.scaled import Setting as Setting
from backsight.estimators.scaled import setting as setting
from backsight.output import whole as whole
from backsight.plugins import Extended as Extended
from backsight.schema import Status as Status
from backsight.studies import Study as Study

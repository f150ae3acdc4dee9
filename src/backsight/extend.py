"""What authors of an extension need: the parts that our own estimators, models and readers use.

An estimator is a frozen dataclass derived from `AbstractEstimator`; `setting` checks and scales,
`assemble` makes a `Recursion` of a measurement update and a time update (`Halves`), and loops are
`scan` and `iterate`. `backsight.testing.check_estimator` says whether it keeps its promises.
"""

from backsight.algebra.factor import cholesky_semidefinite as cholesky_semidefinite
from backsight.algebra.factor import smallest_pivot as smallest_pivot
from backsight.algebra.factor import solve_spd as solve_spd
from backsight.algebra.symmetric import unvech as unvech
from backsight.algebra.symmetric import vech as vech
from backsight.algebra.update import gain as gain
from backsight.algebra.update import joseph as joseph
from backsight.algebra.update import masked as masked
from backsight.algebra.update import measured as measured
from backsight.algebra.update import noise_of as noise_of
from backsight.data.reader import READERS as READERS
from backsight.engine.loops import iterate as iterate
from backsight.engine.loops import scan as scan
from backsight.engine.recursion import Channel as Channel
from backsight.engine.recursion import Recursion as Recursion
from backsight.estimators import ALL_ESTIMATORS as ALL_ESTIMATORS
from backsight.estimators import ESTIMATORS as ESTIMATORS
from backsight.estimators.base import ESTIMATE_CHANNELS as ESTIMATE_CHANNELS
from backsight.estimators.base import AbstractEstimator as AbstractEstimator
from backsight.estimators.base import Setting as Setting
from backsight.estimators.base import setting as setting
from backsight.estimators.parts.filtering import Halves as Halves
from backsight.estimators.parts.filtering import assemble as assemble
from backsight.estimators.parts.filtering import carry_inputs as carry_inputs
from backsight.estimators.parts.filtering import choose as choose
from backsight.estimators.parts.filtering import data_inputs as data_inputs
from backsight.estimators.parts.filtering import packed as packed
from backsight.estimators.parts.filtering import physical as physical
from backsight.estimators.parts.gaussian import FLAGS as FLAGS
from backsight.estimators.parts.gaussian import clip as clip
from backsight.estimators.parts.gaussian import correct as correct
from backsight.estimators.parts.gaussian import innovation as innovation
from backsight.estimators.parts.gaussian import predict as predict
from backsight.estimators.parts.gaussian import updated as updated
from backsight.plugins import Extended as Extended
from backsight.schema import Status as Status
from backsight.studies import Study as Study

"""A problem: everything that a problem file says, checked."""

import dataclasses
from collections.abc import Collection, Mapping
from pathlib import Path

from backsight.description import Printed
from backsight.errors import ProblemError
from backsight.estimators.base import AbstractEstimator
from backsight.models.model import Model
from backsight.problem.reading.tables import FollowTable, RecordingTable, SearchTable, TuneTable


@dataclasses.dataclass(frozen=True)
class Problem(Printed):
    """A recording, a model with what is unknown among its states, and estimators.

    Parameters
    ----------
    title : str
        Heading of tables and report.
    path : Path
        The problem file; paths in it are relative to its folder.
    text : str
        The problem file as it was read.
    recording : RecordingTable
        Where the data is.
    model : Model
        Augmented by the parameters and disturbances to estimate.
    estimators : dict
        Name to estimator, in the order of the file.
    smoothed : set of str
        Names of the estimators whose recording is smoothed.
    followed : dict
        Name of an estimator that follows hits to how it does.
    searched : dict
        Name of an estimator that looks for forces in the whole recording to how it does.
    reference : dict
        State to known value [its unit].
    tune : TuneTable
        What to tune.
    report : bool
        Whether a page is wanted.
    """

    title: str
    path: Path
    text: str
    recording: RecordingTable
    model: Model
    estimators: Mapping[str, AbstractEstimator]
    smoothed: frozenset[str]
    followed: Mapping[str, FollowTable]
    searched: Mapping[str, SearchTable]
    reference: Mapping[str, float]
    tune: TuneTable
    report: bool
    covariance: bool

    def check_by_sample(self, names: Collection[str], what: str) -> None:
        """Raise `ProblemError` if `what` goes sample by sample, and an estimator does not."""
        for name in names:
            for key, whole in (("follow", self.followed), ("search", self.searched)):
                if name in whole:
                    raise ProblemError(
                        f"estimators.{name}.{key}: {what} goes sample by sample, and this takes a "
                        f"whole recording; take an estimator without {key}"
                    )

"""Whether estimates of parameters rest on how far an unknown force is assumed to walk.

The band of a parameter holds for the walk that was assumed. The estimation is repeated with other
walks; if the innovations speak for one of them, or do not speak against it, and the estimate moves
out of its band, the band is worth nothing. Compare Hausman, "Specification tests in econometrics",
Econometrica 46(6), 1978, https://doi.org/10.2307/1913827.
"""

import dataclasses

from backsight.analysis.observability._identifiability import listed_and, remedy
from backsight.description import Printed
from backsight.rounding import plus_minus, significant
from backsight.types import Array

REJECTED = 3.3
"""Loss of log-likelihood from which on the innovations speak against a walk (level 1 %)."""

MOVED = 3.0
"""Standard deviations by which an estimate moves if the band is not to be believed."""


@dataclasses.dataclass(frozen=True)
class Trial(Printed):
    """Estimates at the end of the recording with a walk of the forces so many times as large.

    Parameters
    ----------
    factor : float
    log_likelihood : float
        Of all innovations.
    x, std : (n,) array
        Estimates of the parameters and their standard deviations [their units].
    """

    factor: float
    log_likelihood: float
    x: Array
    std: Array


@dataclasses.dataclass(frozen=True)
class WalkDependence(Printed):
    """Estimates of constant parameters under several walks of unknown forces.

    Parameters
    ----------
    parameters, forces : tuple of str
    assumed : Trial
        With the walk as it is in the noise.
    others : tuple of Trial
    """

    parameters: tuple[str, ...]
    forces: tuple[str, ...]
    assumed: Trial
    others: tuple[Trial, ...]

    @property
    def possible(self) -> tuple[Trial, ...]:
        """Other walks that the innovations do not speak against, the most likely first."""
        least = self.assumed.log_likelihood - REJECTED
        found = [t for t in self.others if t.log_likelihood > least]
        return tuple(sorted(found, key=lambda t: -t.log_likelihood))

    def sentences(self, x: Array, std: Array) -> tuple[str, ...]:
        """Say which estimates are moved out of their bands by a walk that is as likely.

        Parameters
        ----------
        x, std : (n,) array
            Estimates and bands that are to be judged, of an estimator with the same noise.
        """
        for trial in self.possible:
            moved = [i for i in range(len(x)) if self._moved(trial, i, float(x[i]), float(std[i]))]
            if moved:
                return (self._sentence(trial, moved, x, std),)
        return ()

    def _moved(self, trial: Trial, i: int, x: float, std: float) -> bool:
        """Whether both the judging filter and the judged estimate are off by more than the band."""
        own = abs(trial.x[i] - self.assumed.x[i]) > MOVED * self.assumed.std[i]
        return bool(own and abs(trial.x[i] - x) > MOVED * std)

    def _sentence(self, trial: Trial, moved: list[int], x: Array, std: Array) -> str:
        names, forces = listed_and([self.parameters[i] for i in moved]), listed_and(self.forces)
        size = trial.factor if trial.factor > 1 else 1 / trial.factor
        word = "larger" if trial.factor > 1 else "smaller"
        gain = trial.log_likelihood - self.assumed.log_likelihood
        liked = (
            f"which the innovations favour by {significant(gain, 2)} in log-likelihood"
            if gain > REJECTED
            else "which the innovations cannot tell from the assumed one"
        )
        values = ", ".join(
            f"{self.parameters[i]} is {plus_minus(trial.x[i], trial.std[i])} instead of "
            f"{plus_minus(float(x[i]), float(std[i]))}"
            for i in moved
        )
        return (
            f"{names} cannot be told from {forces}: with a walk about {significant(size, 2)} times "
            f"{word}, {liked}, {values}; the bands hold for the assumed walk only, so "
            f"{remedy(forces, names)}"
        )

r"""Parameters that cannot be seen are frozen instead of drifting.

A parameter with a random walk of the variance :math:`q` per sample, of which n samples say nothing,
has a variance that grows by :math:`n q`. So

.. math:: r = \frac{P_{k+n} - P_k}{n q}

is the share of what the walk forgets that the measurements do not bring back: 1 where nothing is
excited, 0 in the steady state, negative while something is learnt. Above one half the walk is
switched off (its factor, an input of the model, see `backsight.estimators.varied_noise`): the
estimate stays where it is, and so does its band. It is switched on again when the measurements
take as much of the variance in n samples as the walk would add.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from backsight.errors import ProblemError
from backsight.estimators.base import AbstractEstimator
from backsight.estimators.varied_noise import NoisePart, VariedNoise
from backsight.live.engine import LiveEstimation, LiveRows
from backsight.models.augment import with_idle_inputs
from backsight.models.model import Model

SEEN = "seen__"
"""In front of the name of a parameter: the factor of its random walk, 1 or 0."""

UNSEEN = 0.5
"""Share of what is forgotten that is not brought back, from which on a parameter is frozen."""


@dataclasses.dataclass(frozen=True)
class Freezable:
    """An estimator whose random walks can be switched off.

    Parameters
    ----------
    estimator : AbstractEstimator
    model : Model
        With an input for each walk.
    walks : dict
        Parameter to the variance that its walk adds per sample.
    """

    estimator: AbstractEstimator
    model: Model
    walks: Mapping[str, float]


def freezable(
    estimator: AbstractEstimator, model: Model, dt: float, *, parameters: Sequence[str]
) -> Freezable:
    """Return the estimator with factors of the walks of parameters.

    Raises
    ------
    ProblemError
        If it cannot switch noise off, or no parameter walks.
    """
    if not estimator.varies_noise:
        raise ProblemError(
            f"live.freeze: {estimator.title} cannot freeze a parameter; take another estimator, "
            "such as ekf, or leave it out"
        )
    noise, _ = estimator.assumed
    Q, Qc = noise.process(model), noise.density(model)
    names = [s.name for s in model.states]
    parts, walks, rest = [], {}, {"Q": Q.copy(), "Qc": Qc.copy()}
    for name in parameters:
        k = names.index(name)
        if model.states[k].positive or not (Q[k, k] or Qc[k, k]):
            continue
        for word, matrix in (("Q", Q), ("Qc", Qc)):
            own = np.zeros_like(matrix)
            own[k, k] = matrix[k, k]
            rest[word] = rest[word] - own
            if matrix[k, k]:
                parts.append(NoisePart((SEEN + name,) * 2, **{word: own}))
        walks[name] = float(Q[k, k] + dt * Qc[k, k])
    if not walks:
        raise ProblemError(
            "live.freeze: no parameter has a random walk, so none can drift; leave it out"
        )
    fields = {f.name: getattr(noise, f.name) for f in dataclasses.fields(noise)}
    fields |= {"sigma_w": None, "Q": None, "Qc": None}
    fields |= {word: matrix for word, matrix in rest.items() if matrix.any()}
    varied = VariedNoise(**fields, parts=tuple(parts))
    return Freezable(
        dataclasses.replace(estimator, noise=varied),
        with_idle_inputs(model, [SEEN + name for name in walks]),
        walks,
    )


class Freezer:
    """Which parameters are seen, told from how their variances change.

    Parameters
    ----------
    estimation : LiveEstimation
    walks : dict
        Parameter to the variance that its walk adds per sample.
    window : int
        Samples after which it is judged.
    tell : callable
        Told which parameter is frozen, and which again not.
    """

    def __init__(
        self,
        estimation: LiveEstimation,
        walks: Mapping[str, float],
        *,
        window: int,
        tell: Callable[[str], None],
    ) -> None:
        model = estimation.model
        states, inputs = [s.name for s in model.states], [s.name for s in model.inputs]
        self._estimation, self._window, self._tell = estimation, window, tell
        self._states = [states.index(name) for name in walks]
        self._inputs = [inputs.index(SEEN + name) for name in walks]
        self.names, self._walks = list(walks), np.array(list(walks.values()))
        self._begun: tuple[int, np.ndarray] | None = None
        self.frozen = np.zeros(len(walks), bool)

    def look(self, rows: LiveRows) -> None:
        """Judge new samples; a change takes effect from the next sample that is estimated."""
        if not len(rows):
            return
        newest = rows.start + len(rows) - 1
        variance = rows.values["x_std"][-1, self._states] ** 2
        if self._begun is None or newest < self._begun[0]:
            self.frozen = rows.u[-1, self._inputs] == 0  # also after a restart
            self._begun = (newest, variance)
            return
        since, before = self._begun
        if newest - since < self._window:
            return
        grown = (variance - before) / ((newest - since) * self._walks)
        unseen = np.where(self.frozen, grown + 1 > 0, grown > UNSEEN) & np.isfinite(variance)
        for j in np.flatnonzero(unseen != self.frozen):
            slot = np.array([self._estimation.done])
            self._estimation.put([self._inputs[j]], slot, np.array([[0.0 if unseen[j] else 1.0]]))
            self._tell(
                f"{self.names[j]} cannot be seen and is frozen: excite the machine"
                if unseen[j]
                else f"{self.names[j]} can be seen again"
            )
        self.frozen = unseen
        self._begun = (newest, variance)

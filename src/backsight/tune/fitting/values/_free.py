"""What a fit may change, as a user says it."""

import dataclasses
from collections.abc import Iterator
from typing import Annotated, Literal

from backsight.description import Description, Positive, Range, Sound

MATRICES = ("R", "Q", "Qc")
"""What has a structure."""


@dataclasses.dataclass(frozen=True)
class Free(Description):
    r"""A value that is found, with what is known of it before.

    Parameters
    ----------
    name : str
        ``sigma_y``, ``sigma_w``, ``sigma_x0``, ``x0``: all standard deviations of sensors, of the
        steps of states that walk, of the prior, or all start values; with the name of a signal
        behind a dot (``sigma_y.q``) one of them. ``R``, ``Q``, ``Qc``, ``P0``: a factor of the
        whole covariance; ``Q.v``, ``Qc.v``: one variance or density on its diagonal. The name of a
        parameter of the model. The name of a setting of the estimator that is a number, such as
        ``alpha``; or several by name, ``sigma_force``; or an array, ``Gamma``, of which a factor is
        found, as of the ``poles`` of a `Luenberger` observer how much faster errors fade.
        ``wind.sigma``, ``wind.length``: size and scale of time of the process that a force follows
        (also ``memory``, ``frequency``); ``wind`` both.
        ``delay.y``: by how much the samples of an input or output come late [s];
        `sigma` must say how much that may be.
    spread : float, optional
        Factor by which the value given may be wrong, one standard deviation: the prior of its
        logarithm is normal. 30 for noise and prior, 3 for parameters of the model, 10 for settings
        if not given; infinite if nothing is known, so that the data alone decide.
    sigma : float, optional
        The same as a difference [unit of the value], for values that may change their sign: the
        prior is normal. Start values have that of `Prior` if neither is given.
    per : "all", "recording", or sequence of str
        One value for all recordings, one for each, or one for each group of recordings: the group
        of every recording.
    structure : "scale", "diagonal", "full", or sequence of str
        Of ``R``, ``Q``, ``Qc``: one factor for all that is there; every variance; every variance
        and correlation; or the block of every signal, in each of which all is free and between
        which there are no correlations ("" leaves a signal without noise). A value ``Q.v.q`` is
        the partial correlation of v and q, given the signals of the block before q.

    Examples
    --------
    >>> bs.tune.Free("sigma_w.v", spread=10.0).per
    'all'
    """

    name: str
    spread: Annotated[float | None, Range("be above 1", 1.0, above=True, infinite=True)] = None
    sigma: Positive | None = None
    per: Literal["all", "recording"] | tuple[str, ...] = "all"
    structure: Literal["scale", "diagonal", "full"] | tuple[str, ...] = "scale"

    def conflicts(self, sound: Sound) -> Iterator[str]:
        """See `Description.conflicts`."""
        if sound("spread", "sigma") and self.spread is not None and self.sigma is not None:
            yield f"'{self.name}': give either spread or sigma"
        if sound("name") and not self.name:
            yield "a free value needs a name"
        if sound("name", "structure") and self.structure != "scale" and self.name not in MATRICES:
            yield f"'{self.name}' has no structure; that is for {', '.join(MATRICES)}"
        if sound("structure", "sigma") and self.structure != "scale" and self.sigma is not None:
            yield f"'{self.name}': the prior of a structure is given by spread"


@dataclasses.dataclass(frozen=True)
class Choice(Description):
    """A setting of the estimator that is one of several values, such as the horizon N.

    Parameters
    ----------
    name : str
        Path of the field: ``N``, ``arrival``, ``adaptive.window``.
    options : tuple
        Values of the field.

    Examples
    --------
    >>> bs.tune.Choice("N", (5, 10, 20)).options
    (5, 10, 20)
    """

    name: str
    options: tuple[object, ...]

    def conflicts(self, sound: Sound) -> Iterator[str]:
        """See `Description.conflicts`."""
        if sound("options") and len(self.options) < 2:
            yield f"'{self.name}': a choice needs two options or more"

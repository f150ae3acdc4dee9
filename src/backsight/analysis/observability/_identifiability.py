r"""How well a recording will tell constant parameters, and how much of that rests on a walk.

An unknown force that walks at random may take over what a parameter does. By the linearised
estimation, the standard deviation of a parameter beside the force per that without it is
:math:`1 / \sqrt{1 - R^2}`, where :math:`R` is the multiple correlation of its effect with those of
the force at all samples (the root of the variance inflation factor). If it is large, the force can
explain nearly everything that tells the parameter; what is left is how little the force walks by
assumption.

Sources: Raue et al., "Structural and practical identifiability analysis of partially observed
dynamical models by exploiting the profile likelihood", Bioinformatics 25(15), 2009,
https://doi.org/10.1093/bioinformatics/btp358; Tichavsky, Muravchik, Nehorai, "Posterior Cramer-Rao
bounds for discrete-time nonlinear filtering", IEEE Transactions on Signal Processing 46(5), 1998,
https://doi.org/10.1109/78.668800 (without process noise of the state the bound along a motion is
the covariance of the filter linearised there).
"""

import dataclasses
from collections.abc import Sequence

from backsight.description import Printed
from backsight.rounding import significant

STEP = 3.0
"""Factor by which the walk of a force is varied."""

EXPLAINED = 3.0
"""A force that makes a band so many times wider can explain what tells the parameter."""

FOLLOWS = 1.5
"""A band that grows so much with a walk that is `STEP` times larger rests on the walk."""

HALF = 0.5
"""Share of the prior from which on a band is held by that, and does not grow with the walk."""


@dataclasses.dataclass(frozen=True)
class ExpectedBand(Printed):
    """Expected standard deviations of one parameter at the end of a recording [unit].

    Parameters
    ----------
    name, unit : str
    prior : float
        Before it.
    std : float
        After it.
    without : float
        The same if the forces did not walk.
    wider : float
        The same if they walked `STEP` times as far.
    """

    name: str
    unit: str
    prior: float
    std: float
    without: float
    wider: float

    @property
    def explained(self) -> bool:
        """Whether the forces can explain nearly all that tells this parameter."""
        rests = self.wider > FOLLOWS * self.std or self.std > HALF * self.prior
        return self.std > EXPLAINED * self.without and rests


@dataclasses.dataclass(frozen=True)
class Identifiability(Printed):
    """How well constant parameters can be told along a motion; prints itself.

    Parameters
    ----------
    samples : int
        Samples of the motion.
    parameters : tuple of ExpectedBand
    forces : tuple of str
        States that nothing moves but a random walk.
    flat : tuple of str
        Sentences on what is hardly known better than before, see `flat_directions`.
    """

    samples: int
    parameters: tuple[ExpectedBand, ...]
    forces: tuple[str, ...]
    flat: tuple[str, ...]

    @property
    def sound(self) -> bool:
        """Whether the recording tells every parameter, and not by the assumed walk of a force."""
        return not self.flat and not any(p.explained for p in self.parameters)

    def __str__(self) -> str:
        return "\n".join(self.lines())

    def lines(self) -> list[str]:
        """What the bands will be, what is flat, and which parameters a force can explain."""
        listed = ", ".join(_known(p) for p in self.parameters)
        found = [f"Expected after {self.samples} samples of this motion: {listed}."]
        found += [f"{text[0].upper()}{text[1:]}." for text in self.flat]
        hidden = [p for p in self.parameters if p.explained]
        if not hidden:
            return found
        names, forces = listed_and([p.name for p in hidden]), listed_and(self.forces)
        bands = ", ".join(
            f"{p.name} ± {significant(p.without, 2)} and ± {significant(p.wider, 2)}"
            for p in hidden
        )
        found.append(
            f"{forces} can explain nearly all that tells {names}: without a walk, and with one "
            f"{STEP:g} times larger, it would be {bands}. A band is only as right as the walk that "
            f"is assumed; {remedy(forces, names)}."
        )
        return found


def listed_and(names: Sequence[str]) -> str:
    """``a, b and c``."""
    return f"{', '.join(names[:-1])} and {names[-1]}" if len(names) > 1 else names[0]


def remedy(forces: str, names: str) -> str:
    """What to do about parameters that forces can explain."""
    return (
        f"measure {forces}, assume no more walk than the innovations ask for, give {names} a "
        "narrower prior, or excite the machine in more ways"
    )


def _known(p: ExpectedBand) -> str:
    unit = f" {p.unit}" if p.unit else ""
    return f"{p.name} ± {significant(p.std, 2)}{unit} (before ± {significant(p.prior, 2)})"

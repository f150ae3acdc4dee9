"""What the outputs of a model say about its states, in words."""

import dataclasses

from backsight.description import Printed


@dataclasses.dataclass(frozen=True)
class Observability(Printed):
    """What the outputs of a model say about its states; prints itself in words.

    Parameters
    ----------
    model : str
    states : tuple of str
    rank : int
        Number of independent combinations of states that the outputs determine.
    samples : int
        How many successive samples (derivatives of the output, for a continuous linear model)
        that takes: the observability index.
    weakest : float
        Smallest singular value that counts, as a share of the largest.
    tolerance : float
        Share of the largest singular value below which one is zero.
    hidden : tuple of str
        States and combinations of states that cannot be seen, independent of each other.
    lasting : tuple of (complex, str)
        Hidden modes that do not decay: eigenvalue and combination. With one of them no estimator's
        error decays. Empty along a trajectory.
    repairs : tuple of str
        Candidates any one of which makes everything visible.
    window : int
        Samples of the trajectory, 0 for a linear model.
    """

    model: str
    states: tuple[str, ...]
    rank: int
    samples: int
    weakest: float
    tolerance: float
    hidden: tuple[str, ...]
    lasting: tuple[tuple[complex, str], ...]
    repairs: tuple[str, ...]
    window: int

    @property
    def observable(self) -> bool:
        """Whether every state can be seen."""
        return not self.hidden

    @property
    def detectable(self) -> bool:
        """Whether what cannot be seen decays by itself; along a trajectory, `observable`."""
        return self.observable or (not self.lasting and not self.window)

    def __str__(self) -> str:
        return "\n".join(self.lines())

    def lines(self) -> list[str]:
        """The verdict in sentences, the first one alone if nothing is wrong."""
        n = len(self.states)
        over = f" over {self.window} samples of this motion" if self.window else ""
        basis = f"weakest singular value {self.weakest:.1e}, tolerance {self.tolerance:.0e}"
        if self.observable:
            return [f"{self.model}: observable{over}, {_enough(self.samples)} ({basis})"]
        if self.detectable:
            verdict = "not observable, but detectable: what cannot be seen decays by itself"
        elif self.window:
            verdict = f"not observable{over}"
        else:
            verdict = "not detectable: the error of some states will never decay"
        found = [f"{self.model}: {verdict} ({self.rank} of {n} states seen, {basis})"]
        found += [f"cannot be seen: {text}" for text in self.hidden]
        found += [
            f"does not decay: {text} (eigenvalue {_number(value)})" for value, text in self.lasting
        ]
        if self.repairs:
            found.append(f"a sensor for any one of these would do: {', '.join(self.repairs)}")
        else:
            found.append("no single candidate for a sensor would do")
        if self.window:
            found.append("or excite the machine more: constants show only while it moves")
        return found


def _enough(samples: int) -> str:
    return "one sample suffices" if samples == 1 else f"{samples} samples suffice"


def _number(value: complex) -> str:
    return f"{value.real:.4g}" if abs(value.imag) < 1e-12 else f"{value:.4g}"

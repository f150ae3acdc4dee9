"""What one window tells the next about the forces that it found (Algorithm 1)."""

import dataclasses
from typing import Literal, TypeAlias

import casadi as ca
import numpy as np

from backsight.description import Count, Description, Positive, PositiveOrInfinite
from backsight.engine.loops import scan
from backsight.types import Array

Reading: TypeAlias = Literal["separate", "prior", "release"]


@dataclasses.dataclass(frozen=True)
class Carryover(Description):
    r"""Forces above the threshold are expected again, one step nearer to the window's beginning.

    The paper's :math:`\bar\alpha^*` is the last estimate and :math:`P_{\alpha^*}` its variance plus
    the drift; of a force that is new, the drift alone.

    Parameters
    ----------
    drift : (float, float)
        Variance that is added at the window's first and last step, linear in between [unit of the
        force, squared]. Small values hold on to the first guess of a force, which is the worst.
    reading : {"separate", "prior", "release"}
        ``separate`` gives an expected force an extra state beside its :math:`\alpha`: the l1 norm
        finds forces, the extra state has their size without the bias of the l1 norm. ``prior``
        puts the expectation on :math:`\alpha` itself, beside its l1 norm. ``release`` does the
        same and leaves the l1 norm out.
    age : int
        A force is carried over once it was seen in so many samples.
    change : float
        Largest difference between an expected force and what it then is,
        :math:`\nu_{\alpha^*} \in N_{\alpha^*}` of eq. 14 [unit of the force].

    Examples
    --------
    >>> bs.forces.Carryover(drift=(1e-3, 1e-2)).reading
    'separate'
    """

    drift: tuple[Positive, Positive]
    reading: Reading = "separate"
    age: Count = 1
    change: PositiveOrInfinite = np.inf

    def weights(self, mean: ca.MX, variance: ca.MX, lam: float) -> list[ca.MX]:
        """Priors of the next window: weights of l1, information and mean of alpha, of extras.

        All are matrices (atoms, steps).
        """
        v = ca.SX.sym("v", variance.shape[0])
        known = ca.if_else(v > 0, 1 / v, 0)
        zero, full = ca.SX.zeros(v.numel()), ca.SX.ones(v.numel()) * lam
        m = ca.SX.sym("m", v.numel())
        columns = {
            "separate": [full, zero, zero, known, m],
            "prior": [full, known, m, zero, zero],
            "release": [ca.if_else(v > 0, 0, lam), known, m, zero, zero],
        }[self.reading]
        body = ca.Function("expected", [m, v], [ca.densify(c) for c in columns])
        return scan(body, variance.shape[1], carry=[], xs=[mean, variance])[1]

    def carry(
        self,
        slid: ca.MX,
        found: tuple[ca.MX, ca.MX, ca.MX],
        before: ca.MX,
        *,
        threshold: float,
        seen: Array,
    ) -> list[ca.MX]:
        """Start, expectations and their variances for the next window, (atoms, steps) each.

        Parameters
        ----------
        slid : MX
            1 if the next window begins one sample later.
        found : tuple of MX
            Alpha, extra states and the variance of their sum, (atoms, steps).
        before : MX
            Variances of what this window had expected.
        threshold : float
        seen : (steps,) array
            In how many samples the force of a step of the next window has been seen by now.
        """
        alpha, extra, variance = found
        atoms, steps = alpha.shape
        g, h = ca.SX.sym("slid"), ca.SX.sym("drift")
        here, a, e, v, b = (ca.SX.sym(n, atoms) for n in ("here", "a", "e", "v", "b"))
        total = a + e
        found_here = ca.logic_and(ca.fabs(total) >= threshold, total != 0)
        keep = ca.logic_and(found_here, h > 0)
        mean = ca.if_else(keep, total, 0) * g
        spread = ca.if_else(keep, ca.if_else(b > 0, v, 0) + h, 0) * g
        fresh = ca.if_else(keep, 0, total) if self.reading == "separate" else total
        body = ca.Function(
            "carry_over",
            [g, here, a, e, v, b, h],
            [ca.if_else(g, fresh, here), mean, spread],
        )
        drift = np.linspace(*self.drift, steps) * (seen >= self.age)
        columns = [alpha, *map(later, (alpha, extra, variance, before)), ca.MX(ca.DM(drift).T)]
        return scan(_every(body), steps, carry=[slid], xs=columns)[1]


def later(columns: ca.MX) -> ca.MX:
    """The same steps as seen from one sample later: the first leaves, the last is empty."""
    return ca.horzcat(columns[:, 1:], ca.MX.zeros(columns.shape[0], 1))


def slide(slid: ca.MX, columns: ca.MX) -> ca.MX:
    """The columns as they are, or `later`, if the window slides."""
    rows = columns.shape[0]
    flag, here, there = ca.SX.sym("slid"), ca.SX.sym("here", rows), ca.SX.sym("there", rows)
    body = ca.Function("slide", [flag, here, there], [ca.if_else(flag, there, here)])
    return scan(_every(body), columns.shape[1], carry=[slid], xs=[columns, later(columns)])[1][0]


def _every(body: ca.Function) -> ca.Function:
    """Return the body with its first argument handed on from pass to pass."""
    inputs = [ca.SX.sym(body.name_in(i), *body.size_in(i)) for i in range(body.n_in())]
    return ca.Function(body.name(), inputs, [inputs[0], *body.call(inputs)])

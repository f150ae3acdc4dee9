r"""Sensors without noise: a covariance of the measurement that is only positive semidefinite.

The update of a Kalman filter is well posed as long as :math:`S = H P H' + R` is positive: an exact
reading fixes one combination of the states, and with a factor of the covariance (see
`square_root`) nothing is subtracted that should leave zero. What it cannot do is take in a reading
whose prediction has no variance left: the second of two exact sensors of one thing, or a state that
is known exactly already. Such a row of S depends on the rows above it, its pivot is rounding, and
the sample is left out like one that was not measured; the status says so.
"""

import dataclasses

import casadi as ca

from backsight.algebra.update import measured
from backsight.estimators.parts.filtering import Halves
from backsight.estimators.parts.flags import Flags
from backsight.estimators.parts.leaf import Results, leaf, notation
from backsight.estimators.scaled import Setting
from backsight.estimators.uncertainty import covariance_faults

LEFT = 1e-13
"""Share of the variance of an innovation that counts, beside those of the rows above it."""

ROUNDING = 1e-12
"""Standard deviation of an output, by the size of the states that it is made of, below which it is
rounding."""


def exact_sensors(s: Setting) -> bool:
    """Whether a combination of the outputs is measured without noise."""
    return any(covariance_faults(s.R, what="R", singular=False))


def with_exact_sensors(s: Setting, halves: Halves) -> Halves:
    """The same filter, which leaves out what is known exactly before it is measured."""
    correct = correcting_exactly(s, innovation=halves.innovation, correct=halves.correct)
    return dataclasses.replace(halves, correct=correct)


def correcting_exactly(s: Setting, *, innovation: ca.Function, correct: ca.Function) -> ca.Function:
    """The same measurement update, which leaves out what is known exactly before.

    Both are as in `Halves`.
    """
    if not exact_sensors(s):
        return correct
    given = [ca.MX.sym(correct.name_in(i), *correct.size_in(i)) for i in range(correct.n_in())]
    x, spread, u, y, mask = given
    _, S = innovation(*given)
    kept, left_out = telling(s)(x, S, u, mask)
    x_post, spread_post, flags = correct(x, spread, u, y, kept)
    results = [x_post, spread_post, _redundant(flags, left_out)]
    return ca.Function("correct_exactly", given, results)


def telling(s: Setting) -> ca.Function:
    """``(x, S, u, mask) -> (mask, 1 if a row was left out)``, by the pivots of S = L D L'."""
    ny = s.model.ny

    def formula(x: ca.SX, S: ca.SX, u: ca.SX, mask: ca.SX) -> Results:
        seen, kept = measured(mask), ca.SX(mask)
        H = ca.jacobian(s.model.output(x, u), x)
        sizes = ca.mtimes(ca.fabs(H), ca.fmax(ca.fabs(x), 1))
        L, d = ca.SX.zeros(ny, ny), []
        for i in range(ny):
            for j in range(i):
                # A row that is out has no pivot, and takes nothing from those below.
                done = sum((L[i, k] * L[j, k] * d[k] for k in range(j)), ca.SX(0))
                counts = d[j] > 0
                L[i, j] = ca.if_else(counts, (S[i, j] - done) / ca.if_else(counts, d[j], 1), 0)
            pivot = S[i, i] - sum((L[i, k] ** 2 * d[k] for k in range(i)), ca.SX(0))
            least = ca.fmax(LEFT * S[i, i], (ROUNDING * sizes[i]) ** 2)
            tells = ca.logic_and(seen[i], pivot > least)
            d.append(ca.if_else(tells, pivot, 0))
            kept[i] = ca.if_else(tells, mask[i], 0)
        left_out = ca.if_else(ca.sum1(measured(kept)) < ca.sum1(seen), 1, 0)
        return {"mask_kept": kept, "left_out": left_out}

    return leaf("telling", {**notation(s), "left_out": 1}, formula)


def _redundant(flags: ca.MX, left_out: ca.MX) -> ca.MX:
    """Raise `Flags.redundant`."""
    raised, out = ca.SX.sym("flags", flags.numel()), ca.SX.sym("left_out")
    told = dataclasses.replace(Flags.of(raised), redundant=out)
    return ca.Function("redundant", [raised, out], [told.vector()])(flags, left_out)

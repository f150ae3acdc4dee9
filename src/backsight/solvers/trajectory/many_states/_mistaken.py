"""True covariances of many states, see `backsight.solvers.trajectory._mistaken`."""

import dataclasses

import casadi as ca

from backsight.engine.dense import (
    add_product,
    all_entries,
    plus_product,
    product_of,
    solve_triangular,
    symmetrise,
    transpose,
)
from backsight.solvers.trajectory.chain import Chain
from backsight.solvers.trajectory.many_states._forward import noise_of_transition
from backsight.solvers.trajectory.many_states._symbols import SampleMatrices, recorded
from backsight.types import Array


def newest_of_many(chain: Chain, more: Array) -> ca.Function:
    """Covariance of the newest sample's error, over a transition and its updates."""
    nx, z, past = chain.nx, SampleMatrices.of(chain), recorded(chain)
    T0 = ca.MX.sym("T", nx * nx)
    T = _carried(chain, z, ca.reshape(T0, nx, nx), more)
    for update in _updates(chain, z, past):
        T = update.spread(T)
    return ca.Function("newest", [T0, *past.values(), *z.symbols], [ca.vec(T)])


def beside_of_many(chain: Chain, more: Array) -> ca.Function:
    """The same, with the error of an earlier sample: ``(T, C, D, V) -> (T, C, D, V)``.

    C is the covariance of the earlier error with the newest one that the window believes in, D the
    true one, and V that of the earlier error.
    """
    nx, z, past = chain.nx, SampleMatrices.of(chain), recorded(chain)
    before = [ca.MX.sym(k, nx * nx) for k in "TCDV"]
    T, C, D, V = (ca.reshape(k, nx, nx) for k in before)
    T = _carried(chain, z, T, more)
    C, D = (add_product(ca.MX.zeros(nx, nx), k, z.F) for k in (C, D))
    for u in _updates(chain, z, past):
        earlier = u.by_inverse(product_of(C, u.rows, turned=(False, True)))
        seen = product_of(D, u.rows, turned=(False, True))
        RT = product_of(u.rows, T)
        S = symmetrise(u.noisy(product_of(RT, u.rows, turned=(False, True))))
        both = product_of(earlier, seen, turned=(False, True))
        V = V - both - transpose(both)
        V = plus_product(V, product_of(earlier, S), earlier, turned=(False, True))
        D = u.left_out(plus_product(D, earlier, RT, minus=True))
        D = plus_product(D, u.noise * earlier, u.K, turned=(False, True))
        C, T = u.left_out(C), u.spread(T)
    inputs = [*before, *past.values(), *z.symbols]
    return ca.Function("beside", inputs, [ca.vec(k) for k in (T, C, D, V)])


@dataclasses.dataclass(frozen=True)
class _Update:
    """An update with some rows: a limit that is active, or all outputs of a sample.

    Parameters
    ----------
    K, rows : MX
        (nx, k) and (k, nx).
    noise : float
        Variance of what each row is told with.
    inverse : MX
        One over the variance of the innovation of a limit, or the factor of S of the outputs.
    """

    K: ca.MX
    rows: ca.MX
    noise: float
    inverse: ca.MX

    def by_inverse(self, X: ca.MX) -> ca.MX:
        """X S^-1."""
        if self.inverse.is_scalar():
            return X * self.inverse
        half = solve_triangular(self.inverse, transpose(X))
        return transpose(solve_triangular(self.inverse, half, turned=True))

    def noisy(self, S: ca.MX) -> ca.MX:
        """S with the noise of the rows."""
        return S + self.noise * ca.MX(ca.densify(ca.DM.eye(S.shape[0])))

    def left_out(self, X: ca.MX) -> ca.MX:
        """X (I - K H)'."""
        seen = product_of(X, self.rows, turned=(False, True))
        return plus_product(X, seen, self.K, turned=(False, True), minus=True)

    def spread(self, T: ca.MX) -> ca.MX:
        """(I - K H) T (I - K H)' + r K K'."""
        left = self.left_out(transpose(self.left_out(T)))
        return symmetrise(plus_product(left, self.noise * self.K, self.K, turned=(False, True)))


def _carried(chain: Chain, z: SampleMatrices, T: ca.MX, more: Array) -> ca.MX:
    """F T F' + Q, with the noise that was left out."""
    Q = noise_of_transition(chain, z)[0] + z.before[0] * ca.MX(ca.DM(more))
    half = transpose(add_product(ca.MX.zeros(chain.nx, chain.nx), T, z.F))
    return symmetrise(add_product(Q, half, z.F))


def _updates(chain: Chain, z: SampleMatrices, past: dict[str, ca.MX]) -> list[_Update]:
    """In their order: the limits on the state, then the outputs."""
    nx, ny, K = chain.nx, chain.ny, ca.reshape(past["K"], chain.nx, chain.n)
    on_state = [r for r in range(chain.n) if not chain.noise[r].any()]
    limits = [_Update(K[:, r], z.A[r, :], float(chain.softness[r]), past["g"][r]) for r in on_state]
    K_y, factor = ca.reshape(past["K_y"], nx, ny), ca.reshape(past["g_y"], ny, ny)
    return [*limits, _Update(K_y, all_entries(z.H), 1.0, factor)]

r"""The true covariance of an estimate whose window was told less noise than there is.

With the gains of the window as they are, the error of the newest sample obeys
:math:`e \leftarrow (I - K h')(F e + w) - K v` whatever the noise, and its covariance T

.. math:: T \leftarrow F T F' + Q + \Delta Q, \qquad T \leftarrow (I - K h') T (I - K h')' + K r K'

row by row (Joseph form), with the noise :math:`\Delta Q` that was left out. The error of an earlier
sample is followed beside it, as in fixed-point smoothing: its gain is :math:`C h / S` with the
covariance C of the two errors that the window believes in.

Source: Gelb (ed.), "Applied optimal estimation", 1974, sections 5.3 (fixed-point smoothing) and 7.2
(filters with wrong covariances).
"""

import dataclasses

import casadi as ca

from backsight.algebra.symmetric import vech
from backsight.engine.loops import scan
from backsight.solvers.trajectory import many_states
from backsight.solvers.trajectory._imposed import limited_noise
from backsight.solvers.trajectory.chain import Chain, Stage, constant
from backsight.solvers.trajectory.smoother import forward_pass
from backsight.types import Array


def mistaken(chain: Chain, back: int, more: Array) -> ca.Function:
    """``(delta, P, *stages, side, force) -> P`` of the sample `back` samples before the last one.

    Parameters
    ----------
    chain : Chain
    back : int
    more : (nx, nx) array
        Covariance of the noise of a transition that the window was not told of.
    """
    nx, n = chain.nx, chain.N + 1
    delta, P = ca.MX.sym("delta", nx), ca.MX.sym("P", chain.size_P)
    stages = [ca.MX.sym(k, size, n) for k, size in chain.inputs.items()]
    records = forward_pass(chain).call([delta, P, *stages])
    columns = [*records, *stages]
    at = n - back

    # Up to the wanted sample; from there with its error beside the newest one.
    whole = _unpack(chain)
    (T,), _ = scan(_newest(chain, more), at, carry=[whole(P)], xs=[k[:, :at] for k in columns])
    if back:
        C = whole(records[1][:, at - 1])
        end, _ = scan(
            _beside(chain, more), back, carry=[T, C, T, T], xs=[k[:, at:] for k in columns]
        )
        T = end[3]
    return ca.Function("mistaken", [delta, P, *stages], [_pack(chain)(T)])


def _unpack(chain: Chain) -> ca.Function:
    """A stored covariance to its matrix, column by column."""
    if chain.dense:
        return _as_it_is(chain)
    stored = ca.SX.sym("P", chain.size_P)
    return ca.Function("unpack", [stored], [ca.vec(chain.matrix(stored))])


def _pack(chain: Chain) -> ca.Function:
    """A matrix column by column to how covariances are stored."""
    if chain.dense:
        return _as_it_is(chain)
    T = ca.SX.sym("T", chain.nx, chain.nx)
    return ca.Function("pack", [ca.vec(T)], [vech(T)])


def _as_it_is(chain: Chain) -> ca.Function:
    stored = ca.MX.sym("P", chain.size_P)
    return ca.Function("as_it_is", [stored], [stored])


@dataclasses.dataclass(frozen=True)
class _Sample:
    """Symbols of a sample, its transition and noise, and its scalar updates (K, h, g, r)."""

    symbols: list[ca.SX]
    F: ca.SX
    Q: ca.SX
    rows: list[tuple[ca.SX, ca.SX, ca.SX, float]]

    @classmethod
    def of(cls, chain: Chain, more: Array) -> "_Sample":
        z = Stage.of(chain)
        past = {k: ca.SX.sym(k, size) for k, size in chain.records.items()}
        K, K_y = (ca.reshape(past[k], chain.nx, -1) for k in ("K", "K_y"))
        A, H = ca.SX(chain.A, z.A), ca.SX(chain.H, z.H)
        on_state = [r for r in range(chain.n) if not chain.noise[r].any()]
        limits = [(K[:, r], A[r, :].T, past["g"][r], float(chain.softness[r])) for r in on_state]
        outputs = [(K_y[:, j], H[j, :].T, past["g_y"][j], 1.0) for j in range(chain.ny)]
        return cls(
            symbols=[*past.values(), *z.symbols],
            F=ca.SX(chain.F, z.F),
            Q=limited_noise(chain, z)[1] + z.before[0] * constant(more),
            rows=[*limits, *outputs],
        )


def _newest(chain: Chain, more: Array) -> ca.Function:
    """Covariance of the newest sample's error, over a transition and its updates."""
    if chain.dense:
        return many_states.newest_of_many(chain, more)
    nx, s = chain.nx, _Sample.of(chain, more)
    T0 = ca.SX.sym("T", nx, nx)
    T = s.F @ T0 @ s.F.T + s.Q
    for K, h, _, r in s.rows:
        left = ca.SX.eye(nx) - K @ h.T
        T = left @ T @ left.T + r * (K @ K.T)
    return ca.Function("newest", [ca.vec(T0), *s.symbols], [ca.vec(ca.densify(T))])


def _beside(chain: Chain, more: Array) -> ca.Function:
    """The same, with the error of an earlier sample: ``(T, C, D, V) -> (T, C, D, V)``.

    C is the covariance of the earlier error with the newest one that the window believes in, D the
    true one, and V that of the earlier error.
    """
    if chain.dense:
        return many_states.beside_of_many(chain, more)
    nx, s = chain.nx, _Sample.of(chain, more)
    T0, C0, D0, V0 = before = [ca.SX.sym(k, nx, nx) for k in "TCDV"]
    T, C, D, V = s.F @ T0 @ s.F.T + s.Q, C0 @ s.F.T, D0 @ s.F.T, V0
    for K, h, g, r in s.rows:
        left = ca.SX.eye(nx) - K @ h.T
        earlier, seen = (C @ h) * g, D @ h
        V = V - earlier @ seen.T - seen @ earlier.T
        V = V + (h.T @ T @ h + r) * (earlier @ earlier.T)
        D = (D - earlier @ (h.T @ T)) @ left.T + r * (earlier @ K.T)
        C = C @ left.T
        T = left @ T @ left.T + r * (K @ K.T)
    after = [ca.vec(ca.densify(k)) for k in (T, C, D, V)]
    return ca.Function("beside", [*map(ca.vec, before), *s.symbols], after)

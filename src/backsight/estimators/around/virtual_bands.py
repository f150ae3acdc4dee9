"""Formulas of virtual outputs: derivatives, and deviations by what is known; see `_virtual`."""

import dataclasses

import casadi as ca
import numpy as np

from backsight.algebra.symmetric import unvech
from backsight.engine.dense import UNROLL, add_product, transpose
from backsight.models.model import Model
from backsight.models.signals import Virtual
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class Surroundings:
    """What virtual outputs need to know beside what a method puts out.

    Parameters
    ----------
    model : Model
        With virtual outputs, physical.
    W : (nx, nx) array
        Covariance of the process noise that is added to the rates.
    background : (nf,) array
        Standard deviation of forces that act beside those that a method finds.
    """

    model: Model
    W: Array
    background: Array


def slopes_of(
    virtual: Virtual, around: Surroundings, forces: tuple[str, ...]
) -> tuple[ca.Function, ca.DM | None]:
    """``(x, u, d) -> (z, G', Gd, G_w W G_w')``, and G if it is constant.

    Of the last only the diagonal, (nz,).
    """
    m = around.model
    x, u, d = ca.SX.sym("x", m.nx), ca.SX.sym("u", m.nu), ca.SX.sym("d", len(forces))
    w, p = ca.SX.sym("w", m.nx), ca.SX(m.theta)
    for i, s in enumerate(m.parameters):
        if s.name in forces:
            p[i] = d[forces.index(s.name)]
    g = virtual.g.call([x, u, p, w])[0]
    z = ca.substitute(g, w, ca.SX.zeros(m.nx))
    Gw = ca.substitute(ca.jacobian(g, w), w, ca.SX.zeros(m.nx))
    of_noise = ca.sum2((Gw @ ca.sparsify(ca.SX(around.W))) * Gw)
    G, Gd = ca.jacobian(z, x), ca.sparsify(ca.jacobian(z, d))
    slopes = ca.Function(
        "virtual_outputs",
        [x, u, d],
        [ca.densify(z), ca.densify(G.T), Gd, ca.densify(of_noise)],
        ["x", "u", "d"],
        ["z", "Gt", "Gd", "of_noise"],
    )
    return slopes, ca.DM(G) if G.is_constant() else None


def variance_of(P: ca.MX, Gt: ca.MX, constant: ca.DM | None) -> ca.MX:
    """Diagonal of G P G', (nz,), of the lower triangle of P."""
    n, nz = Gt.shape
    if n > UNROLL and constant is not None:
        # Constant weights of the entries of the triangle: the covariance is not unpacked.
        G, (rows, columns) = np.array(constant), np.triu_indices(n)
        weights = G[:, rows] * G[:, columns] * np.where(rows == columns, 1.0, 2.0)
        sparse = ca.MX(ca.sparsify(ca.DM(weights)))
        return add_product(ca.MX.zeros(1, nz), ca.reshape(P, 1, P.numel()), sparse).T
    triangle, columns = ca.SX.sym("P", P.numel()), ca.SX.sym("Gt", n, nz)
    if n <= UNROLL:
        variance = ca.densify(_diagonal(columns, unvech(triangle) @ columns))
        return ca.Function("virtual_variance", [triangle, columns], [variance])(P, Gt)
    whole = ca.Function("virtual_covariance", [triangle], [unvech(triangle)])
    product, PGt = add_product(ca.MX.zeros(n, nz), whole(P), transpose(Gt)), ca.SX.sym("PGt", n, nz)
    return ca.Function("virtual_variance", [columns, PGt], [_diagonal(columns, PGt)])(Gt, product)


def of_states(slopes: ca.Function, *, looks_back: bool) -> ca.Function:
    """``(variance, of_noise) -> sigma`` where unknown forces are not contained."""
    variance, of_noise, _, _ = _symbols(slopes)
    sigma = _joined(variance, of_noise, looks_back=looks_back)
    return ca.Function("virtual_deviation", [variance, of_noise], [sigma])


def together(slopes: ca.Function, *, looks_back: bool) -> ca.Function:
    """``(variance, of_noise, G', Gd, P_xd, P_d) -> sigma`` with states and forces together."""
    variance, of_noise, Gt, Gd = _symbols(slopes)
    nx, nf = Gt.shape[0], Gd.shape[1]
    cross, triangle = ca.SX.sym("P_xd", nx * nf), ca.SX.sym("P_d", nf * (nf + 1) // 2)
    Pxd, Pd = ca.reshape(cross, nx, nf), unvech(triangle)
    all_of_it = variance + _diagonal(Gd.T, Pd @ Gd.T) + 2 * _diagonal(Gt, Pxd @ Gd.T)
    sigma = _joined(all_of_it, of_noise, looks_back=looks_back)
    return ca.Function("virtual_deviation", [variance, of_noise, Gt, Gd, cross, triangle], [sigma])


def apart(slopes: ca.Function, around: Surroundings, *, looks_back: bool) -> ca.Function:
    """``(variance, of_noise, Gd, d_std) -> sigma``: deviations are added, which is the most."""
    variance, of_noise, _, Gd = _symbols(slopes)
    d_std = ca.SX.sym("d_std", Gd.shape[1])
    beside = ca.sum2((Gd @ ca.SX(ca.diag(ca.DM(around.background**2)))) * Gd)
    sigma = _joined(variance, of_noise + beside, looks_back=looks_back)
    sigma += ca.fabs(Gd) @ d_std
    return ca.Function("virtual_deviation", [variance, of_noise, Gd, d_std], [ca.densify(sigma)])


def _symbols(slopes: ca.Function) -> list[ca.SX]:
    """Variance by the states, variance by process noise, G' and Gd."""
    shape = slopes.size_out("Gt")
    return [
        ca.SX.sym("variance", shape[1]),
        ca.SX.sym("of_noise", shape[1]),
        ca.SX.sym("Gt", *shape),
        ca.SX.sym("Gd", slopes.sparsity_out("Gd")),
    ]


def _diagonal(At: ca.SX, B: ca.SX) -> ca.SX:
    """Diagonal of A B, (n,)."""
    return ca.sum1(At * B).T


def _joined(variance: ca.SX, of_noise: ca.SX, *, looks_back: bool) -> ca.SX:
    """Deviation by estimate and process noise, independent of each other or not."""
    known = ca.fmax(variance, 0)  # of a quantity that is known exactly, rounding is left
    if looks_back:
        return ca.densify(ca.sqrt(known) + ca.sqrt(of_noise))
    return ca.densify(ca.sqrt(known + of_noise))

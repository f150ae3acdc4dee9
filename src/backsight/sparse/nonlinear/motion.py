r"""Motion of a nonlinear model with unknown forces, and its derivatives, scaled.

.. math:: x_{k+1} = f(x_k, u_k, d_k), \qquad y_k = h(x_k, u_k, d_k)
"""

import dataclasses
from collections.abc import Callable

import casadi as ca
import numpy as np

from backsight.discrete.steps import advanced, over_sample
from backsight.estimators.force_estimator import Forced
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class Slopes:
    """Derivatives of next states and outputs by states and forces.

    Parameters
    ----------
    A, E, C, F : (n, nx, nx), (n, nx, nf), (n, ny, nx), (n, ny, nf) arrays
    """

    A: Array
    E: Array
    C: Array
    F: Array


@dataclasses.dataclass(frozen=True)
class ForcedMotion:
    """A model, sample by sample.

    Parameters
    ----------
    forced : Forced
    ahead, seen : Function
        ``(x, u) -> next x``, ``(x, u) -> y``; the forces are the last inputs.
    slopes : Function
        ``(x, u) -> (A, B, C, D)``.
    called : dict
        What was called before: making a function of many samples takes longer than calling it.
    """

    forced: Forced
    ahead: ca.Function
    seen: ca.Function
    slopes: ca.Function
    called: dict[tuple[str, int], "_Called"] = dataclasses.field(default_factory=dict, repr=False)

    @staticmethod
    def of(forced: Forced) -> "ForcedMotion":
        """Trace a model with its unknown forces as last inputs."""
        s = forced.system.s
        x, u = ca.SX.sym("x", s.model.nx), ca.SX.sym("u", s.model.nu)
        y, end = s.model.output(x, u), s.model.rhs(x, u)
        if s.model.continuous:
            end, n = x, s.integrator.steps
            for _ in range(n):
                end = advanced(s.integrator, s.model, end, ua=u, ub=u, h=s.dt / n)
        by = over_sample(s.integrator, s.model, s.dt)
        a, b = ca.MX.sym("x", s.model.nx), ca.MX.sym("u", s.model.nu)
        looks = ca.Function("looks", [x, u], [ca.densify(ca.jacobian(y, z)) for z in (x, u)])
        slopes = [ca.densify(m) for m in (*by(a, b, b)[1:], *looks(a, b))]
        return ForcedMotion(
            forced,
            ca.Function("ahead", [x, u], [ca.densify(end)]),
            ca.Function("seen", [x, u], [ca.densify(y)]),
            ca.Function("slopes", [a, b], slopes),
        )

    def inputs(self, u: Array, d: Array) -> Array:
        """All inputs (n, nu + nf) of known ones (n, nu) and forces (n, nf) in their own unit."""
        return np.hstack([u, d / self.forced.system.s.su[self.forced.nu :]])

    def states(self, x0: Array, v: Array) -> Array:
        """States (n + 1, nx) from the first on, with all inputs (n, nu + nf)."""
        (later,) = self._call("states", len(v), x0, v)
        return np.vstack([x0, later[:, :, 0]])

    def next(self, x: Array, v: Array) -> Array:
        """States (n, nx) a sample after states (n, nx)."""
        return self._call("ahead", len(v), x, v)[0][:, :, 0]

    def outputs(self, x: Array, v: Array) -> Array:
        """Outputs (n, ny) of states (n, nx)."""
        return self._call("seen", len(v), x, v)[0][:, :, 0]

    def slopes_along(self, x: Array, v: Array) -> Slopes:
        """Derivatives along states (n, nx)."""
        nu = self.forced.nu
        unit = self.forced.system.s.su[nu:]
        A, B, C, D = self._call("slopes", len(v), x, v)
        return Slopes(A, B[:, :, nu:] / unit, C, D[:, :, nu:] / unit)

    def _call(self, name: str, n: int, x: Array, v: Array) -> list[Array]:
        """Results (n, rows, columns) of a function of n samples."""
        key = name, n
        if key not in self.called:
            one = self.ahead if name == "states" else getattr(self, name)
            all_samples = one.mapaccum(n) if name == "states" else one.map(n)
            self.called[key] = _Called.of(one, all_samples, n)
        return self.called[key](x, v)


@dataclasses.dataclass(frozen=True)
class _Called:
    """A function of n samples that reads and writes arrays: lists of numbers take far longer.

    Parameters
    ----------
    given, found : list of arrays
        Where it reads and writes.
    run : callable
    kept : tuple
        What `run` works on; CasADi does not hold it.
    """

    given: list[Array]
    found: list[Array]
    run: Callable[[], None]
    kept: tuple[object, ...]

    @staticmethod
    def of(one: ca.Function, all_samples: ca.Function, n: int) -> "_Called":
        """A function of a sample, and that of all of them."""
        given = [np.zeros(all_samples.numel_in(i)) for i in range(all_samples.n_in())]
        # In CasADi's memory the columns of all samples are one after the other.
        found = [np.zeros((n, one.size2_out(i), one.size1_out(i))) for i in range(one.n_out())]
        buffer, run = all_samples.buffer()
        for i, array in enumerate(given):
            buffer.set_arg(i, array.data)  # pyright: ignore[reportCallIssue]
        for i, array in enumerate(found):
            buffer.set_res(i, array.data)  # pyright: ignore[reportCallIssue]
        return _Called(given, found, run, (all_samples, buffer))

    def __call__(self, *given: Array) -> list[Array]:
        for place, values in zip(self.given, given, strict=True):
            place[:] = np.ravel(values)
        self.run()
        return [array.transpose(0, 2, 1).copy() for array in self.found]


@dataclasses.dataclass(frozen=True)
class Readings:
    """Scaled data.

    Parameters
    ----------
    u : (n, nu) array
        Known inputs.
    y : (n, ny) array
    root : (n, ny, ny) array
        What makes the noise of a sample white; rows of what was not measured are zero.
    noise : (n, ny, ny) array
        Its covariance; the nominal one of what was not measured.
    """

    u: Array
    y: Array
    root: Array
    noise: Array

    def between(self, first: int, last: int) -> "Readings":
        """Samples from the first on, without the last."""
        part = slice(first, last)
        return Readings(self.u[part], self.y[part], self.root[part], self.noise[part])

    @property
    def counts(self) -> Array:
        """Number of measurements of every sample, (n,)."""
        return np.einsum("kii->ki", self.root).astype(bool).sum(axis=1)


def readings_of(forced: Forced, data: tuple[Array, Array, Array]) -> Readings:
    """Scale inputs, outputs and mask, and whiten the noise of every pattern of measurements."""
    (u, y, mask), s = data, forced.system.s
    roots, noise = np.zeros((len(y), *s.R.shape)), np.empty((len(y), *s.R.shape))
    known: dict[bytes, tuple[Array, Array]] = {}
    for k, row in enumerate(mask):
        key = row.tobytes()
        if key not in known:
            known[key] = _whitened(s.R, row)
        roots[k], noise[k] = known[key]
    return Readings(u / s.su[: forced.nu], np.where(mask > 0, y / s.sy, 0.0), roots, noise)


def _whitened(R: Array, row: Array) -> tuple[Array, Array]:
    """What makes the noise of the measured outputs of a row of the mask white, and it itself."""
    factor = np.where(row > 0, row, 1.0)
    noise, root = R / np.outer(factor, factor), np.zeros(R.shape)
    seen = np.flatnonzero(row > 0)
    if len(seen):
        square = np.ix_(seen, seen)
        root[square] = np.linalg.inv(np.linalg.cholesky(noise[square]))
    return root, noise

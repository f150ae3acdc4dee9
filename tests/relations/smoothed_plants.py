"""Random linear plants, and what smoothing has to make of their recordings."""

import numpy as np
import xarray as xr

import backsight as bs
from oracles.smoothing import Plant


def random_plant(seed: int, *, nx: int = 3, ny: int = 2, m: int = 0, direct: bool = True) -> Plant:
    """Stable, with correlated noises."""
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((nx, nx))
    spread = [rng.standard_normal((k, k)) for k in (nx, nx, ny)]
    Q, P0, R = (s @ s.T / len(s) + 0.1 * np.eye(len(s)) for s in spread)
    return Plant(
        A=0.9 * A / np.abs(np.linalg.eigvals(A)).max(),
        B=rng.standard_normal((nx, 1)),
        C=rng.standard_normal((ny, nx)),
        D=rng.standard_normal((ny, 1)),
        Q=0.1 * Q,
        R=R,
        x0=rng.standard_normal(nx),
        P0=P0,
        E=rng.standard_normal((nx, m)) if m else None,
        F=direct * rng.standard_normal((ny, m)) if m else None,
    )


def names(letter: str, n: int) -> list[str]:
    return [f"{letter}{i}" for i in range(n)]


def model_of(p: Plant, dt: float = 1.0) -> bs.Model:
    """The plant as a model; its forces are parameters."""
    nx, ny, m = len(p.A), len(p.C), 0 if p.E is None else p.E.shape[1]
    E, F = (np.zeros((k, 0)) if v is None else v for k, v in ((nx, p.E), (ny, p.F)))
    signals = [*names("x", nx), "u0", *names("d", m)]

    def sums(matrix: np.ndarray, letter: str) -> dict[str, str]:
        pairs = [zip(row, signals, strict=True) for row in matrix]
        terms = [" + ".join(f"({v:.17g})*{s}" for v, s in row) for row in pairs]
        return dict(zip(names(letter, len(matrix)), terms, strict=True))

    return bs.from_equations(
        states=dict.fromkeys(names("x", nx), ""),
        inputs={"u0": ""},
        outputs=dict.fromkeys(names("y", ny), ""),
        parameters=dict.fromkeys(names("d", m), (0.0, "")),
        equations=sums(np.hstack([p.A, p.B, E]), "x"),
        output_equations=sums(np.hstack([p.C, p.D, F]), "y"),
        dt=dt,
    )


def data_of(p: Plant, n: int, *, missing: float, seed: int = 7) -> tuple[np.ndarray, np.ndarray]:
    """Inputs and outputs, which need not be the plant's."""
    rng = np.random.default_rng(seed)
    u, y = rng.standard_normal((n, 1)), rng.standard_normal((n, len(p.C)))
    y[rng.random(y.shape) < missing] = np.nan
    return u, y


def recording_of(u: np.ndarray, y: np.ndarray, dt: float = 1.0) -> xr.Dataset:
    outputs = dict.fromkeys(names("y", y.shape[1]), "")
    return bs.from_arrays(u=u, y=y, dt=dt, inputs={"u0": ""}, outputs=outputs)


def assumed(p: Plant) -> dict[str, object]:
    x0 = dict(zip(names("x", len(p.x0)), p.x0, strict=True))
    return {"noise": bs.Noise(Q=p.Q, R=p.R), "prior": bs.Prior(x0=x0, P0=p.P0)}


def assert_smoothed(result: xr.Dataset, states: np.ndarray, P: np.ndarray, tol: float = 1e-10):
    """In standard deviations, entry by entry; the oracle's zeros are zero to rounding."""
    size = np.sqrt(np.maximum(np.einsum("kii->ki", P), 1e-10))
    assert np.abs((result["x_hat"].values - states) / size).max() < tol
    scale = size[:, :, None] * size[:, None, :]
    assert np.abs((result["P"].values - P) / scale).max() < tol

"""The checks of the study."""

import numpy as np

from backsight.estimators.kalman import KalmanFilter
from backsight.estimators.linear_windows import LinearMHE, RecursiveMHE, gains, in_units
from backsight.estimators.parts.linear import linear
from backsight.estimators.uncertainty import Noise
from backsight.types import Array
from backsight_studies.checks import Check
from backsight_studies.lecture import expected
from backsight_studies.lecture.experiment import (
    BATCH,
    RECURSIVE,
    STEP,
    STEP_HORIZON,
    UNIT,
    WIDE,
    Experiment,
)
from backsight_studies.lecture.plants import EXAMPLE, A, B, C


def checks(experiment: Experiment) -> list[Check]:
    """All checks: gains, recursion against batch, Kalman filters, increments, limits."""
    return [*_gains(), *_multirate(experiment), *_kalman(), *_dynamics(experiment)]


def _within(name: str, error: float, tolerance: float, where: str) -> Check:
    """Check that a difference is small."""
    return Check(name, "equal", error, f"at most {tolerance:g}", bool(error <= tolerance), where)


def _largest(found: Array, wanted: Array) -> float:
    return float(np.abs(found - wanted).max())


def _gains() -> list[Check]:
    batch = LinearMHE(UNIT, WIDE, N=4).gains(EXAMPLE, 1.0)
    L, L_out = RecursiveMHE(UNIT, WIDE, N=4).gains(EXAMPLE, 1.0)
    ahead = np.linalg.matrix_power(A, 4)
    found = {
        "M": _largest(batch.M, expected.M),
        "N_u": _largest(batch.N_u[:, :4], expected.N_u),
        "P_N": _largest(batch.P, ahead @ expected.P_N @ ahead.T),
        "L": _largest(L[:, 0], expected.L_N),
        "L tilde": _largest(L_out[:, 0], expected.Ltilde_N),
    }
    rows = [
        _within(f"gain {name} of the two-state example, N = 4", error, 1e-9, "expected.py")
        for name, error in found.items()
    ]
    for alpha, modulus in expected.MODULUS.items():
        values = RecursiveMHE(UNIT, WIDE, N=4, alpha=alpha).eigenvalues(EXAMPLE, 1.0)
        error = _largest(np.abs(values), np.array(modulus))
        name = f"modulus of the error's eigenvalues, alpha = {alpha:g}: {modulus:.6g}"
        rows.append(_within(name, error, 1e-9, "expected.py"))
    return rows


def _multirate(experiment: Experiment) -> list[Check]:
    rows = []
    for (m, N), wanted in expected.MULTIRATE.items():
        system = linear(EXAMPLE, 1.0, noise=UNIT, prior=WIDE, hold="zoh")
        found = in_units(gains(system, N, every=m), system.s).M[:, ::m]
        error = _largest(found, wanted)
        rows.append(_within(f"multirate gain, m = {m}, N = {N}", error, 1e-9, "expected.py"))
    for r in experiment.multirate.values():
        name = f"{r.plant}, m = {r.m}, N = {r.N}"
        if (r.m, r.N) in (*BATCH, *RECURSIVE):
            rows.append(
                _within(f"recursion = batch, 5 slow steps: {name}", r.batch_error, 1e-12, "figures")
            )
            rows.append(_within(f"exact without noise: {name}", r.exact, 1e-12, "figures"))
    return rows


def _kalman() -> list[Check]:
    rows = [
        _within(
            "alpha = 0 and a window that grows: Kalman filter without prior",
            _growing_window(),
            1e-10,
            "verdicts.py",
        )
    ]
    for N in (4, 8):
        P = LinearMHE(UNIT, WIDE, N=N).gains(EXAMPLE, 1.0).P
        c = C @ np.linalg.matrix_power(np.linalg.inv(A), N)
        Q = A @ P @ c.T @ np.linalg.solve(1 - c @ P @ c.T, c @ P @ A.T)
        K, _ = KalmanFilter(Noise(1.0, Q=(Q + Q.T) / 2), WIDE).steady(EXAMPLE, 1.0)
        L, _ = RecursiveMHE(UNIT, WIDE, N=N).gains(EXAMPLE, 1.0)
        name = f"alpha = 0 and a fixed window, N = {N}: steady Kalman filter"
        rows.append(_within(name, _largest(L, K), 1e-10, "verdicts.py"))
    return rows


def _growing_window() -> float:
    """Largest difference from least squares over all samples since the start."""
    rng, x, worst = np.random.default_rng(0), np.zeros(2), 0.0
    u, y = rng.standard_normal((30, 1)), rng.standard_normal(30)
    rows, response, responses = [], np.zeros(2), []
    for k in range(30):
        rows.append(C[0] @ np.linalg.matrix_power(A, k))
        responses.append(response)
        ahead = np.linalg.matrix_power(A, k)
        if k:
            seen = y[: k + 1] - np.array(responses)[:, 0]
            first = np.linalg.lstsq(np.array(rows), seen, rcond=None)[0]
            full = ahead @ first + response
            if k > 1:
                prior = A @ x + B @ u[k - 1]
                L, _ = RecursiveMHE(UNIT, WIDE, N=k).gains(EXAMPLE, 1.0)
                x = prior + L[:, 0] * (y[k] - prior[0])
            else:
                x = full
            worst = max(worst, _largest(x, full))
        response = A @ response + B @ u[k]
    return worst


def _dynamics(experiment: Experiment) -> list[Check]:
    e, where = experiment.rounding, "rounding.png"
    settled = STEP + STEP_HORIZON
    free, bounded = experiment.limited.rmse
    best = float(experiment.alpha.rmse.min())
    return [
        _within("alpha = 1: rounding error after 10 samples", float(e[10]), 1e-12, where),
        Check(
            "alpha = 1: the rounding error after 250 samples is as large as the state",
            "larger than 0.1", float(e[250]), "larger than 0.1", bool(e[250] > 0.1), where,
        ),
        _within("alpha = 1, started again: error", float(experiment.again.max()), 1e-9, where),
        _within(
            "incremental model: error after the input step has left the window",
            float(experiment.incremental[settled:].max()), 1e-12, "increments.png",
        ),
        Check(
            "plain model: bias under the unknown input", "larger than 1",
            float(experiment.plain[-1]), "larger than 1", bool(experiment.plain[-1] > 1),
            "increments.png",
        ),
        Check(
            "Kalman filter against the best alpha: rms error", "at most as large",
            experiment.alpha.kalman / best, "at most 1.01",
            bool(experiment.alpha.kalman <= 1.01 * best), "alpha.png",
        ),
        Check(
            "bounds on the unknown force: rms error without per with them", "larger than 1",
            free / bounded, "larger than 1", bool(free > bounded), "limits.png",
        ),
    ]  # fmt: skip

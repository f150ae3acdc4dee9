"""Linear Kalman filters of other libraries, each as its own documentation recommends."""

import numpy as np
import scipy

from backsight.types import Array
from benchmarks import sizes
from benchmarks.contest import Contender
from benchmarks.sizes import Linear


def numpy_blas(states: int, outputs: int) -> Contender:
    """Products by BLAS, the gain by a Cholesky factor, and a covariance that stays symmetric."""
    g = sizes.linear(states, outputs)
    factor, solve = scipy.linalg.lapack.dpotrf, scipy.linalg.lapack.dpotrs

    def work() -> Array:
        x, P = np.zeros(states), g.P0.copy()
        found = np.empty((len(g.y), states))
        for k in range(len(g.y)):
            CP = g.C @ P
            L, _ = factor(CP @ g.C.T + g.R, lower=1)
            Kt, _ = solve(L, CP, lower=1)
            x = x + (g.y[k] - g.C @ x) @ Kt
            P = P - CP.T @ Kt
            found[k] = x
            x = g.A @ x
            P = g.A @ P @ g.A.T + g.Q
            P = (P + P.T) / 2
        return found

    return _contender(work, g, states, outputs)


def statsmodels(states: int, outputs: int) -> Contender:
    """Compiled by Cython; converged covariances are reused by its own test."""
    from statsmodels.tsa.statespace.kalman_filter import KalmanFilter

    g = sizes.linear(states, outputs)
    kf = KalmanFilter(k_endog=outputs, k_states=states, k_posdef=states)
    kf.bind(np.asfortranarray(g.y.T))
    kf["design"], kf["obs_cov"], kf["transition"] = g.C, g.R, g.A
    kf["selection"], kf["state_cov"] = np.eye(states), g.Q
    kf.initialize_known(np.zeros(states), g.P0)

    def work() -> Array:
        return kf.filter().filtered_state.T

    return _contender(work, g, states, outputs)


def dynamax(states: int, outputs: int) -> Contender:
    """Compiled by JAX for the whole recording."""
    import jax
    from dynamax.linear_gaussian_ssm import LinearGaussianSSM, lgssm_filter

    jax.config.update("jax_enable_x64", True)
    g = sizes.linear(states, outputs)
    A, C, Q, R, P0 = map(jax.numpy.asarray, (g.A, g.C, g.Q, g.R, g.P0))
    params, _ = LinearGaussianSSM(states, outputs).initialize(
        initial_mean=jax.numpy.zeros(states),
        initial_covariance=P0,
        dynamics_weights=A,
        dynamics_covariance=Q,
        emission_weights=C,
        emission_covariance=R,
    )
    run = jax.jit(lambda y: lgssm_filter(params, y).filtered_means)

    def work() -> Array:
        return np.asarray(run(g.y))

    return _contender(work, g, states, outputs)


def cuthbert(states: int, outputs: int) -> Contender:
    """In square-root form, compiled by JAX for the whole recording."""
    import jax

    jax.config.update("jax_enable_x64", True)
    import jax.numpy as jnp
    from cuthbert import filter as run_filter
    from cuthbert.gaussian import kalman

    g = sizes.linear(states, outputs)
    x, P = _after_first(g)
    roots = [jnp.asarray(np.linalg.cholesky(m)) for m in (P, g.Q, g.R)]
    A, C, start = jnp.asarray(g.A), jnp.asarray(g.C), jnp.asarray(x)
    nothing = jnp.zeros(states), jnp.zeros(outputs)
    method = kalman.build_filter(
        start,
        roots[0],
        get_dynamics_params=lambda model_inputs: (A, nothing[0], roots[1]),  # noqa: ARG005
        get_observation_params=lambda model_inputs: (
            C,
            nothing[1],
            roots[2],
            jnp.asarray(model_inputs),
        ),
    )
    run = jax.jit(lambda y: run_filter(method, y, method.init_prepare()).mean)

    def work() -> Array:
        return np.asarray(run(g.y[1:]))  # the initial state comes first

    return _contender(work, g, states, outputs)


def kalman_py(states: int, outputs: int) -> Contender:
    """Its loop in NumPy."""
    return _kalman_py(states, outputs, "numpy")


def kalman_py_jax(states: int, outputs: int) -> Contender:
    """Its loop compiled by JAX."""
    import jax

    jax.config.update("jax_enable_x64", True)
    return _kalman_py(states, outputs, "jax")


def _kalman_py(states: int, outputs: int, backend: str) -> Contender:
    from kalman_py import KalmanFilter

    g = sizes.linear(states, outputs)
    x, P = _after_first(g)
    kf = KalmanFilter(g.A, g.C, g.Q, g.R, x, P)

    def work() -> Array:
        found = kf.filter(g.y[1:], backend=backend)  # pyright: ignore[reportArgumentType, reportCallIssue]
        return np.vstack([x, np.asarray(found.means)])

    return _contender(work, g, states, outputs)


def fast_kalman(states: int, outputs: int) -> Contender:
    """C++ for fixed small sizes."""
    import kalman

    g = sizes.linear(states, outputs)
    x, P = _after_first(g)
    kf = kalman.LinearKalmanFilter(states, outputs)  # up to 8 each
    kf.F, kf.H, kf.Q, kf.R = (m.ravel().tolist() for m in (g.A, g.C, g.Q, g.R))
    start, spread, rest = x.tolist(), P.ravel().tolist(), g.y[1:]

    def work() -> Array:
        kf.x, kf.P = start, spread
        return np.asarray(kf.update_many(rest)["x"])[None]  # it keeps the last one only

    return Contender(work, len(g.y), sizes.expected(states, outputs)[-1:])


def _after_first(g: Linear) -> tuple[Array, Array]:
    """Mean and covariance after the first measurement, for those that predict before each."""
    S = g.C @ g.P0 @ g.C.T + g.R
    K = np.linalg.solve(S, g.C @ g.P0).T
    P = g.P0 - K @ S @ K.T
    return K @ g.y[0], (P + P.T) / 2


def _contender(work, g: Linear, states: int, outputs: int) -> Contender:
    return Contender(work, len(g.y), sizes.expected(states, outputs))

"""dynamax's extended Kalman filter, compiled by JAX for the whole recording."""

import numpy as np

from backsight.types import Array
from benchmarks.contest import Contender
from benchmarks.ours import expected
from benchmarks.peers.equations import Stage
from benchmarks.problems import Problem


def build(problem: Problem) -> Contender:
    import jax

    jax.config.update("jax_enable_x64", True)
    import jax.numpy as jnp
    from dynamax.nonlinear_gaussian_ssm import ParamsNLGSSM, extended_kalman_filter

    s = problem.setting
    stage = Stage(s, problem.estimator.integrator.substeps)
    params = ParamsNLGSSM(
        initial_mean=jnp.array(s.x0),
        initial_covariance=jnp.array(s.P0),
        dynamics_function=lambda x, u: jnp.array([*stage.ahead(x, u[0]), *x[2:]]),
        dynamics_covariance=jnp.array(s.sampled().Q),
        emission_function=lambda x, _u: stage.output * x[:1],
        emission_covariance=jnp.array(s.R),
    )
    u, y = problem.data[0] / s.su, problem.data[1] / s.sy
    # Its prediction to sample k + 1 takes input number k + 1.
    inputs, outputs = jnp.array(np.vstack([u[:1], u[:-1]])), jnp.array(y)
    run = jax.jit(
        lambda y, u: (
            extended_kalman_filter(
                params, y, inputs=u, output_fields=["filtered_means"]
            ).filtered_means
        )
    )

    def work() -> Array:
        return np.asarray(run(outputs, inputs))

    return Contender(work, len(u), expected(problem))

"""filterpy's extended and unscented Kalman filters."""

import numpy as np

from backsight.types import Array
from benchmarks.contest import Contender
from benchmarks.ours import expected
from benchmarks.peers.equations import Punch, Stage
from benchmarks.problems import Problem


def extended(problem: Problem, samples: int) -> Contender:
    """The extended filter; the user writes model and Jacobian in NumPy."""
    from filterpy.kalman import ExtendedKalmanFilter

    s = problem.setting
    stage = Stage(s, problem.estimator.integrator.substeps)
    H = np.zeros((1, 6))
    H[0, 0] = stage.output
    u, y = problem.data[0] / s.su, problem.data[1] / s.sy

    def work() -> Array:
        ekf = ExtendedKalmanFilter(dim_x=6, dim_z=1)
        ekf.x, ekf.P, ekf.Q, ekf.R = s.x0.copy(), s.P0.copy(), s.sampled().Q, s.R
        x_hat = np.empty((samples, 6))
        for k in range(samples):
            ekf.update(y[k], lambda _x: H, lambda x: H @ x)
            x_hat[k] = ekf.x
            ahead, ekf.F = stage.jacobian(ekf.x, u[k, 0])
            ekf.predict_x = lambda *_, ahead=ahead: setattr(ekf, "x", ahead)
            ekf.predict()
        return x_hat

    return Contender(work, samples, expected(problem))


def unscented(problem: Problem, samples: int) -> Contender:
    """The unscented filter; the model is called once per sigma point."""
    from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

    s = problem.setting
    punch = Punch(s, problem.estimator.integrator.substeps)
    gain = s.sx[0] / s.sy[0]
    u, y = problem.data[0] / s.su, problem.data[1] / s.sy
    points = MerweScaledSigmaPoints(5, alpha=1.0, beta=2.0, kappa=0.0)

    def work() -> Array:
        ukf = UnscentedKalmanFilter(5, 1, s.dt, lambda x: gain * x[:1], punch.ahead, points)
        ukf.x, ukf.P, ukf.Q, ukf.R = s.x0.copy(), s.P0.copy(), s.sampled().Q, s.R
        ukf.sigmas_f = points.sigma_points(ukf.x, ukf.P)
        x_hat = np.empty((samples, 5))
        for k in range(samples):
            ukf.update(y[k])
            x_hat[k] = ukf.x
            ukf.predict(u=u[k, 0])
        return x_hat

    return Contender(work, samples, expected(problem))

"""Implicit models and stiff ones, against SciPy's solvers and models that are solved by hand."""

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq

import backsight as bs
from backsight.algebra.newton import held, newton
from backsight.errors import ModelError
from backsight.models import implicit
from backsight.models.lti import state_space
from backsight.schema import Status
from closeness import assert_close
from relations.linear import Run

K1, A, B, C, M = 1e4, 5e7, 1e8, 20.0, 2.0
DECLARED = {
    "states": {"q": "m", "v": "m/s"},
    "inputs": {"F": "N"},
    "outputs": {"y": "m", "w": "m"},
    "parameters": {"k2": (1.5e4, "N/m")},
}


def springs(**changes) -> bs.Model:
    """Two hardening springs in series with a massless node between them."""
    return implicit(
        residual=lambda xdot, x, z, u, p: [
            xdot.q - x.v,
            M * xdot.v + p.k2 * z.node + B * z.node**3 + C * x.v - u.F,
            K1 * (x.q - z.node) + A * (x.q - z.node) ** 3 - p.k2 * z.node - B * z.node**3,
        ],
        h=lambda x, z, u, p: [x.q, z.node],
        algebraic={"node": "m"},
        **DECLARED | changes,
    )


def in_text() -> bs.Model:
    return bs.from_equations(
        equations={"q": "v", "v": "(F - k2*node - 1e8*node**3 - 20*v) / 2"},
        output_equations={"y": "q", "w": "node"},
        algebraic={"node": "m"},
        constraints={"node": "1e4*(q - node) + 5e7*(q - node)**3 - k2*node - 1e8*node**3"},
        guesses={"node": "0.3*q"},
        **DECLARED,
    )


def node(q: float, k2: float) -> float:
    def g(z):
        return K1 * (q - z) + A * (q - z) ** 3 - k2 * z - B * z**3

    return brentq(g, -abs(q) - 1e-9, abs(q) + 1e-9, xtol=1e-16, rtol=1e-15)


@pytest.mark.parametrize("model", [springs(), in_text()], ids=["residual", "text"])
def test_rates_and_outputs_solve_the_equations(model):
    for q, v in ((0.0, 0.0), (1e-3, -0.2), (-0.02, 1.0), (0.3, 0.0)):
        z = node(q, 1.5e4)
        rates, seen = (np.array(k([q, v], [7.0], [1.5e4])).ravel() for k in (model.f, model.h))
        np.testing.assert_allclose(seen, [q, z], rtol=1e-12, atol=1e-18)
        force = 1.5e4 * z + B * z**3
        np.testing.assert_allclose(rates, [v, (7 - force - C * v) / M], rtol=1e-12, atol=1e-12)
        assert float(model.unsolved([q, v], [7.0], [1.5e4])) < 1e-6


@pytest.mark.parametrize("model", [springs(), in_text()], ids=["residual", "text"])
def test_derivatives_are_those_of_the_implicit_function_theorem(model):
    x, p = ca.SX.sym("x", 2), ca.SX.sym("p", 1)
    slope = ca.jacobian(model.h(x, [0.0], p), ca.vertcat(x, p))
    found = np.array(ca.Function("slope", [x, p], [slope])([0.01, 0.0], [1.5e4]))
    z = node(0.01, 1.5e4)
    near, far = K1 + 3 * A * (0.01 - z) ** 2, 1.5e4 + 3 * B * z**2
    exact = [[1, 0, 0], [near / (near + far), 0, -z / (near + far)]]
    np.testing.assert_allclose(found, exact, rtol=1e-10, atol=1e-20)


def test_a_stiffness_behind_a_massless_node_is_found():
    n, dt = 300, 1e-3
    u = np.repeat(np.random.default_rng(0).standard_normal(n // 10), 10)[:, None] * 60
    model = springs()
    made = bs.simulate(model, u, dt=dt, parameters={"k2": 2e4}, sigma_y=2e-6, substeps=4)
    joint = bs.augment(model, ["k2"])
    e = bs.EKF(
        bs.Noise(sigma_y=2e-6, sigma_w={"v": 1e-6}),
        bs.Prior(sigma_x0={"q": 1e-5, "v": 1e-3, "k2": 5e3}),
    )
    result = Run(e, joint, dt)(u, made["y"].values)
    error, std = result["x_hat"][-1, 2] - 2e4, np.sqrt(result["P"][-1, 2, 2])
    assert abs(error) < 3 * std < 100
    assert not result["status"].any()


def test_a_linear_residual_is_solved_without_iterations():
    model = implicit(
        residual=lambda xdot, x, z, u, p: [
            xdot.q - x.v, M * xdot.v + z.f - u.F, z.f - p.k2 * (x.q - z.s), z.f - 500 * z.s
        ],
        h=lambda x, z, u, p: [x.q, z.f], algebraic={"f": "N", "s": "m"}, **DECLARED,
    )  # fmt: skip
    both = 1.5e4 * 500 / (1.5e4 + 500)
    F, G, H, _ = state_space(model)
    np.testing.assert_allclose(F, [[0, 1], [-both / M, 0]], rtol=1e-12)
    np.testing.assert_allclose(G, [[0], [1 / M]])
    np.testing.assert_allclose(H, [[1, 0], [both, 0]], rtol=1e-12)


def test_no_solution_is_told_in_the_status():
    model = implicit(
        residual=lambda xdot, x, z, u, p: [xdot.q + x.q, z.w**2 + 1 - x.q],
        h=lambda x, z, u, p: [x.q], states={"q": 2.0}, algebraic={"w": 1.0}, outputs={"y": ""},
    )  # fmt: skip
    e = bs.EKF(bs.Noise(sigma_y=0.01), bs.Prior(sigma_x0=0.1))
    y = 2 * np.exp(-0.1 * np.arange(20))[:, None]
    status = Run(e, model, 0.1)(np.zeros((20, 0)), y)["status"]
    lost = (status.astype(int) & int(Status.NOT_SOLVED)) != 0
    assert not lost[:6].any()
    assert lost[8:].all()


@pytest.mark.parametrize(
    ("residual", "says"),
    [
        (lambda xdot, x, z, u, p: [xdot.q - x.v, xdot.v], "2 equations for 3 unknowns: .*'node'"),
        (
            lambda xdot, x, z, u, p: [xdot.q - x.v, xdot.v - z.node, x.q - u.F],
            "no equation to determine 'node'; .*index 1",
        ),
        (lambda xdot, x, z, u, p: [xdot.q - x.w, xdot.v, z.node], "no state 'w'"),
    ],
)
def test_what_is_not_determined_is_named(residual, says):
    with pytest.raises(ModelError, match=says):
        implicit(residual, h=lambda x, z, u, p: [x.q, x.v], algebraic={"node": "m"}, **DECLARED)


def test_a_rootfinder_is_refused_with_what_to_do():
    z, q = ca.SX.sym("z"), ca.SX.sym("q")
    solver = ca.rootfinder("solver", "newton", {"x": z, "p": q, "g": z**3 + z - q})
    x, u, p = ca.MX.sym("x"), ca.MX.sym("u", 0), ca.MX.sym("p", 0)
    f = ca.Function("f", [x, u, p], [solver(x0=0, p=x)["x"]])
    with pytest.raises(ModelError, match=r"'solver'.*describe .*implicit"):
        bs.Model(f=f, h=lambda x, u, p: [x.q], states={"q": ""}, outputs={"y": ""})


def test_numbers_held_for_derivatives():
    v = ca.SX.sym("v")
    of = ca.Function("held", [v], [held(v), ca.jacobian(held(v), v)])
    for value in (0.0, 1.0, -3.7e-12, 2.5e17, -1e-150):
        kept, slope = (float(k) for k in of(value))
        assert abs(kept - value) <= 1e-9 * abs(value)
        assert slope == 0


def test_newton_from_afar():
    """atan from 3, from where full steps go to infinity; a gap, whose slope jumps."""
    c = ca.SX.sym("c")
    for g, far, root in (
        (lambda w: ca.atan(w - c), 3.0, 0.2),
        (lambda w: w + 50 * ca.fmax(w - 0.1, 0) - c, 0.0, (0.2 + 5) / 51),
    ):
        found = newton(g, ca.SX(far))
        w, left = (float(k) for k in ca.Function("root", [c], [found.w, found.left])(0.2))
        assert abs(w - root) < 1e-14
        assert left < 1e-6


def hydraulic() -> bs.Model:
    """A chamber with a pole at -1e6 beside a slow mass, and an orifice that is not linear."""
    return bs.Model(
        f=lambda x, u, p: [
            -1e6 * (x.p - u.s * ca.tanh(x.p + 2)), (10 * x.p - 3 * x.v - 40 * x.q) / 2, x.v, 0
        ],
        h=lambda x, u, p: [x.q], states={"p": "", "v": "", "q": "", "c": ""}, inputs={"s": ""},
        outputs={"y": ""},
    )  # fmt: skip


@pytest.mark.parametrize(
    ("scheme", "error"), [("implicit_midpoint", 3e-3), ("sdirk", 2e-5), ("radau", 2e-5)]
)
def test_implicit_methods_carry_stiff_models(scheme, error):
    """What oscillates in the midpoint rule, which is not L-stable, decays in the others."""
    dt, model = 0.05, hydraulic()
    start = [1.0, 0.3, 0.1, 7.0]
    rates = ca.Function("rates", [(x := ca.SX.sym("x", 4)), (u := ca.SX.sym("u"))],
                        [model.rhs(x, u)])  # fmt: skip
    end = solve_ivp(lambda t, x: np.array(rates(x, 1.5)).ravel(), (0, dt), start, method="Radau",
                    rtol=1e-11, atol=1e-13).y[:, -1]  # fmt: skip
    step = bs.Integrator(scheme, substeps=5)
    X = ca.SX.sym("X", 4)
    moved = step.substep(model.rhs, X, ua=ca.SX(1.5), ub=ca.SX(1.5), h=dt / 5)
    f = ca.Function("step", [X], [moved, ca.jacobian(moved, X)])
    x = np.array(start)
    for _ in range(5):
        x = np.array(f(x)[0]).ravel()
    assert np.abs(x[1:3] - end[1:3]).max() < error
    assert x[3] == 7.0
    slope = np.array(f(x)[1])
    numeric = [(np.array(f(x + 1e-6 * d)[0]) - np.array(f(x - 1e-6 * d)[0])) / 2e-6
               for d in np.eye(4)]  # fmt: skip
    np.testing.assert_allclose(slope, np.hstack(numeric), atol=1e-7)


def test_orders_of_convergence():
    model = bs.sdof(k=40.0, b=3.0)
    exact = np.array([[0, 1], [-40, -3]])
    for scheme, order in (("implicit_midpoint", 2), ("sdirk", 3), ("radau", 3)):
        errors = []
        for n in (8, 16):
            x = ca.SX([1.0, 0.5])
            step = bs.Integrator(scheme, substeps=n)
            for _ in range(n):
                x = step.substep(model.rhs, x, ua=ca.SX(0), ub=ca.SX(0), h=0.4 / n)
            end = np.array(ca.evalf(x)).ravel()
            errors.append(np.abs(end - expm(0.4 * exact) @ [1, 0.5]).max())
        assert abs(np.log2(errors[0] / errors[1]) - order) < 0.3, scheme


def stiff(scheme, engine):
    n, dt, model = 120, 0.02, hydraulic()
    u = np.repeat(np.random.default_rng(1).random(n // 10), 10)[:, None] + 1
    noise, prior = bs.Noise(sigma_y=1e-4, sigma_w={"v": 1e-3}), bs.Prior(sigma_x0=[1, 0.1, 0.1, 0])
    y = np.cumsum(np.random.default_rng(2).standard_normal((n, 1)) * 1e-4, axis=0)
    recording = bs.from_arrays(u=u, y=y, dt=dt, inputs={"s": ""}, outputs={"y": ""})
    estimator = bs.EKF(noise, prior, integrator=bs.Integrator(scheme))
    result = bs.estimate(estimator, model, recording, engine=engine)
    assert scheme in result.attrs["integration"]
    assert not result.status.values.any()
    return result


def test_stiff_estimates_of_two_schemes_and_in_both_engines():
    """The number of steps follows from the modes, also of implicit methods."""
    radau, other, compiled = stiff("radau", "vm"), stiff("sdirk", "vm"), stiff("radau", "native")
    assert_close(radau.x_hat.values[5:, 1:3], other.x_hat.values[5:, 1:3], 1e-2)
    np.testing.assert_allclose(compiled.x_hat, radau.x_hat, rtol=1e-9, atol=1e-12)

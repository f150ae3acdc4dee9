"""How descriptions, models and findings print: short trees, escaped in a notebook."""

import dataclasses
import math
import re

import casadi as ca
import numpy as np
import pytest

import backsight as bs
from backsight.description import Printed, tree
from backsight.models._latex import latex, symbol
from description.everything import descriptions, example

NOISE, PRIOR = bs.Noise(sigma_y=1.0), bs.Prior(sigma_x0=0.5)


@pytest.mark.parametrize("kind", descriptions(), ids=lambda k: k.__name__)
def test_every_description_prints_as_a_short_tree(kind):
    lines = str(kind(**example(kind))).splitlines()
    assert len(lines) <= 10
    assert max(map(len, lines)) <= 100
    assert lines[0].split(":")[0] == kind.__name__
    assert all(line.startswith("├── ") for line in lines[1:-1])
    assert len(lines) == 1 or lines[-1].startswith("└── ")


def test_a_tree_says_what_was_chosen():
    made = bs.EKF(NOISE, PRIOR, integrator=bs.Integrator("heun", 4))
    assert str(made) == (
        "EKF: Extended Kalman filter\n"
        "├── noise        Noise(sigma_y = 1)\n"
        "├── prior        Prior(sigma_x0 = 0.5)\n"
        "├── integrator   Integrator(scheme = heun, substeps = 4, hold = zoh)\n"
        "├── covariance   transition\n"
        "├── measurement  sampled\n"
        "└── gain         converged"
    )


def test_what_was_chosen_comes_before_the_defaults():
    forces = tuple(f"F{i}" for i in range(40))
    made = bs.CompressiveSensingMHE(NOISE, PRIOR, forces=forces, lam=2.0, hold="foh", N=7)
    text = str(made)
    assert "F5, ... 40 in all" in text
    for row in ("lam          2", "N            7", "hold         foh"):
        assert f"── {row}\n" in text
    assert text.splitlines()[-1].startswith("└── and          ")


def test_repr_builds_the_same_again():
    made = bs.MHE(NOISE, PRIOR, N=4, soft={"q": 2.0}, arrival=bs.settings.NoArrival(10.0))
    rooms = (bs, bs.settings)
    names = {n: getattr(room, n) for room in rooms for n in dir(room) if not n.startswith("_")}
    assert eval(repr(made), names | {"inf": math.inf}) == made


def test_names_from_files_neither_break_a_tree_nor_a_notebook():
    evil = "<script>alert(1)</script>\n└── fake"
    made = bs.LinearMHE(NOISE, PRIOR, limits=(bs.settings.Limit(evil, {"x": 1.0}, lower=0.0),))
    without = dataclasses.replace(made, limits=())
    assert len(str(made).splitlines()) == len(str(without).splitlines()) + 1
    page = made._repr_html_()
    assert "<script>" not in page
    assert "&lt;script&gt;" in page
    plant = bs.sdof(k=1.0, b=1.0, name=evil, length=evil.replace("\n", " "))
    assert "<script>" not in plant._repr_html_()
    assert len(tree("a\nb", [("c", "d\re")]).splitlines()) == 2


def test_notebooks_show_the_equations_of_method_and_model():
    page = bs.KalmanFilter(NOISE, PRIOR)._repr_html_()
    assert page.count("$$") == 4
    assert r"\hat x_k^+ = \hat x_k^- + K_k e_k" in page
    assert r"$$\dot{q} = v$$" in bs.sdof(k=1.0, b=1.0)._repr_html_()
    assert r"\begin{aligned}" in bs.AHG(NOISE, PRIOR, gain=1.0, Gamma=1.0)._repr_html_()


@dataclasses.dataclass(frozen=True)
class Found(Printed):
    """A finding."""

    values: dict[str, float]
    table: np.ndarray
    plant: bs.Model
    rival: float | None = None


def test_findings_print_their_fields():
    found = Found({"k": 1.23456}, np.eye(3), bs.sdof(k=1.0, b=2.0))
    assert str(found) == (
        "Found\n├── values  k 1.235\n├── table   3 x 3 array\n└── plant   sdof (continuous)"
    )
    assert found._repr_html_().startswith("<pre>Found\n")


def test_a_comparison_says_what_it_compares():
    plant = bs.sdof(k=100.0, b=1.0)
    given = bs.simulate(plant, np.zeros(30), dt=0.01, sigma_y=0.1)
    found = bs.compare({"first": bs.EKF(NOISE, PRIOR)}, plant, given, engine="vm")
    assert repr(found) == "Comparison of 'first'"
    assert found._repr_html_().startswith("<pre>")


def value_of(formula: str, names: dict[str, float]) -> float:
    """A formula in LaTeX as a number, by a reader of its own."""
    text = formula.split(" = ", 1)[1]
    for i, name in enumerate(names):
        text = re.sub(rf"(?<![A-Za-z\\]){re.escape(name)}(?![A-Za-z])", f" N[{i}] ", text)
    braces = r"\{((?:[^{}]|\{(?:[^{}]|\{(?:[^{}]|\{[^{}]*\})*\})*\})*)\}"
    before = ""
    while before != text:
        before = text
        text = re.sub(rf"\\frac{braces}{braces}", r"((\1)/(\2))", text)
        text = re.sub(rf"\\sqrt{braces}", r"sqrt(\1)", text)
        text = re.sub(rf"\^{braces}", r"**(\1)", text)
    for latex_, python in (
        (r"\left|", "abs("), (r"\right|", ")"), (r"\left(", "("), (r"\right)", ")"),
        (r"\cdot", "*"), (r"\,", "*"), (r"\operatorname{sign}", "sign"), (r"\ln", "log"),
    ):  # fmt: skip
        text = text.replace(latex_, python)
    text = re.sub(r"\\(?=[a-z])", "", text)
    known = {n: getattr(np, n) for n in ("sin", "cos", "tanh", "exp", "sqrt", "log", "sign")}
    return float(eval(text, {"N": [*names.values()], "abs": abs, "min": min, "max": max} | known))


def test_equations_in_latex_mean_what_the_model_does():
    x, v, w = 0.7, 1.3, -0.4
    cases = [
        lambda x, v, w: x - (v - w) - (-x),
        lambda x, v, w: -(x + v) * (w - x) / (v * w) - 2.5e-7 * x,
        lambda x, v, w: (x + v) ** 2 - (x * v) ** 3 + (-x) ** 2,
        lambda x, v, w: 3 * (2 * x) * (v / w) / (x / v),
        lambda x, v, w: ca.sin(x - w) * ca.tanh(v / 1e-3) + ca.exp(-x) ** 2,
        lambda x, v, w: ca.sqrt(x + v) / ca.fabs(w - x) - ca.log(v) * ca.sign(w),
        lambda x, v, w: ca.fmin(x, v - 1) + ca.fmax(x, w) * -1.5,
        lambda x, v, w: 1 / (1 + ca.exp(-v)) - x / (v - (w + x)),
    ]
    plant = bs.Model(
        f=lambda s, u, p: [c(s.x, s.v, p.omega_2) for c in cases][:2],
        h=lambda s, u, p: [c(s.x, s.v, p.omega_2) for c in cases],
        states={"x": "", "v": ""},
        outputs={f"y{i}": "" for i in range(len(cases))},
        parameters={"omega_2": w},
    )
    names = {"x": x, "v": v, symbol("omega_2"): w}
    found = [value_of(formula, names) for formula in latex(plant)]
    expected = [float(c(ca.DM(x), ca.DM(v), ca.DM(w))) for c in cases]
    np.testing.assert_allclose(found, [*expected[:2], *expected], rtol=1e-9)


def test_symbols_and_long_formulas():
    assert [symbol(n) for n in ("q", "x12", "omega_n", "F_left", "mass", "k_1_x")] == [
        "q", "x_{12}", r"\omega_{n}", r"F_{\mathrm{left}}", r"\mathrm{mass}", "k_{1,x}",
    ]  # fmt: skip
    large = bs.lti(
        np.ones((60, 60)), np.ones((60, 1)), np.ones((1, 60)),
        states={f"x{i}": "" for i in range(60)}, inputs={"u": ""}, outputs={"y": ""}, dt=0.1,
    )  # fmt: skip
    formulas = latex(large)
    assert formulas[0].startswith("{x_{0}}^{+} = ")
    assert max(map(len, formulas)) < 1000
    assert r"\ldots" in formulas[0]

"""Beams: against a reference implementation, tables, orthogonality and the equation of motion."""

import numpy as np
import pytest

from backsight.discrete.exact import zoh
from backsight.errors import ModelError
from backsight.models import duffing
from backsight.models.forces.unknown_forces import forces_as_inputs
from backsight.models.lti import lti, state_space
from backsight.models.sampling import check_sampling
from backsight.models.structures import beam
from backsight.models.structures._beam_modes import BOUNDARIES, shapes

SIZE = {"width": 0.025, "thickness": 0.003, "youngs_modulus": 65.9e9, "density": 7502.0}
NODES = [0.125 + 0.04 * i for i in range(8)]
SENSORS = {f"s{i}": ("displacement", NODES[i]) for i in (3, 5, 7)}
"""The cantilever of table 1 of Kirchner et al. 2018 (doi:10.1016/j.ymssp.2017.08.024)."""

# Of that cantilever at 400 Hz, from an independent implementation with the closed-form step of an
# oscillator and hyperbolic shapes: A is [[diag, diag], [diag, diag]]; B for unit forces at the
# nodes, C for displacements at the nodes 3, 5, 7.
A_BLOCKS = [
    [0.9905806131958457, 0.6581176573179063, -0.49056188191489475],
    [0.0024818683169996686, 0.0021329520307244248, 0.000530707169243797],
    [-7.513283301700658, -253.59266131715185, -494.6928035153346],
    [0.9823873765204358, 0.6036936389338657, -0.6125091935439068],
]
B_FIRST = [1.8746295102542127e-06, 6.547338070794296e-06, 5.035828676438182e-06,
           0.001495280201260699, 0.004856515469299183, 0.0016713081396994684]  # fmt: skip
B_LAST = [1.3036317340340544e-05, -1.2047707104193322e-05, 6.699658949464687e-06,
          0.010398293161254766, -0.008936437264801625, 0.0022235058527389066]  # fmt: skip
C_Q = [
    [1.9581842588042124, 2.427180990498985, -2.0616971171788814],
    [3.0536205919670554, -0.337869080894525, -1.6049417628302047],
    [4.189703817092627, -4.189703817092642, 4.189703817092151],
]


_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(150)
GAUSS = (1 + _POINTS) / 2, _WEIGHTS / 2
"""Points and weights of a quadrature from 0 to 1."""


def cantilever(**changes):
    given = {"sensors": SENSORS, "damping": [0.030, 0.037, 0.119], **SIZE} | changes
    return beam(0.405, **given)


def hertz(model):
    """Undamped frequencies of a model by modes."""
    n = model.nx // 2
    return np.sqrt(np.maximum(-np.diag(state_space(model)[0][n:, :n]), 0)) / (2 * np.pi)


def test_matrices_from_sample_to_sample():
    names = {f"F{i}": x for i, x in enumerate(NODES)}
    for model in (
        forces_as_inputs(cantilever(forces=names), list(names)),
        cantilever(inputs=names),
    ):
        A, B, C, D = state_space(model)
        A, B = zoh(A, B, dt=1 / 400)
        blocks = [np.diag(b) for b in A_BLOCKS]
        np.testing.assert_allclose(A, np.block([blocks[:2], blocks[2:]]), rtol=1e-10, atol=1e-15)
        np.testing.assert_allclose(B[:, [0, -1]].T, [B_FIRST, B_LAST], rtol=1e-10)
        np.testing.assert_allclose(C, np.hstack([C_Q, np.zeros((3, 3))]), rtol=1e-10)
        assert not D.any()


@pytest.mark.parametrize(
    ("thickness", "published"),
    [
        (0.0030, [8.76, 54.88, 153.66]),
        (0.0029, [8.47, 53.05, 148.54]),
        (0.0028, [8.17, 51.22, 143.42]),
        (0.0027, [7.88, 49.39, 138.30]),
    ],
)
def test_published_frequencies(thickness, published):
    """Table 3 of the same paper."""
    np.testing.assert_allclose(hertz(cantilever(thickness=thickness)), published, atol=0.01)


@pytest.mark.parametrize(
    ("boundary", "tip"),
    [*((name, 0.0) for name in BOUNDARIES), ("cantilever", 0.3), ("cantilever", 1e3)],
)
def test_shapes_are_orthonormal_up_to_high_modes(boundary, tip):
    """Masses and bending energies by Gauss's quadrature; hyperbolic functions fail at mode 12."""
    found = shapes(boundary, 40, tip=tip)
    x, weights = GAUSS
    phi, end, bend = found.at(x), found.at(1.0)[0], found.at(x, derivative=2)
    masses = phi.T @ (weights[:, None] * phi) + tip * np.outer(end, end)
    np.testing.assert_allclose(masses, np.eye(40), atol=1e-10)
    size = 1 + found.wavenumbers**2
    energies = bend.T @ (weights[:, None] * bend) / np.outer(size, size)
    np.testing.assert_allclose(energies, np.diag((found.wavenumbers**2 / size) ** 2), atol=1e-10)
    for order in (1, 2, 3):
        step = 1e-6
        ahead, behind = (found.at(x[50:100] + s, derivative=order - 1) for s in (step, -step))
        slope, size = (ahead - behind) / (2 * step), (1 + found.wavenumbers) ** order
        here = found.at(x[50:100], derivative=order)
        np.testing.assert_allclose(slope / size, here / size, atol=1e-6)


def test_roots_of_the_tables():
    """Blevins 1979, table 8-1, and limits of the tip mass."""
    roots = {
        "cantilever": [1.87510407, 4.69409113, 7.85475744, 10.99554073, 14.13716839],
        "pinned-pinned": np.pi * np.arange(1, 6),
        "free-free": [0.0, 0.0, 4.73004074, 7.85320462, 10.9956079],
        "clamped-clamped": [4.73004074, 7.85320462, 10.9956079, 14.1371655, 17.2787597],
    }
    for boundary, expected in roots.items():
        np.testing.assert_allclose(shapes(boundary, 5).wavenumbers, expected, rtol=1e-8)
    # A mass of the beam's own, and one so heavy that the beam is clamped and pinned but for a slow
    # swing on its static stiffness, 3 E I / L^3.
    assert shapes("cantilever", 1, tip=1.0).wavenumbers[0] == pytest.approx(1.24792, abs=1e-5)
    heavy = shapes("cantilever", 3, tip=1e6).wavenumbers
    np.testing.assert_allclose(heavy[1:], [3.92660231, 7.06858275], rtol=1e-6)
    assert heavy[0] == pytest.approx((3 / 1e6) ** 0.25, rel=1e-6)


def test_static_deflection_of_many_modes():
    """F L^3 / (3 E I) at a tip, F L^3 / (48 E I) in the middle, strain F L c / (E I) at a root."""
    EI, mass = 2.5, 0.4
    of = {"bending_stiffness": EI, "mass_per_length": mass, "thickness": 0.01, "modes": 60}
    model = beam(
        0.8,
        sensors={"tip": ("displacement", 0.8), "root": ("strain", 0.0)},
        inputs={"F": 0.8},
        **of,
    )
    A, B, C, _ = state_space(model)
    tip, root = C @ np.linalg.solve(-A, B)[:, 0]
    assert tip == pytest.approx(0.8**3 / (3 * EI), rel=1e-6)
    # Positive deflection compresses the side it goes to; the series of the moment ends slowly.
    assert root == pytest.approx(-0.8 * 0.005 / EI, rel=0.02)
    middle = {"sensors": {"y": ("displacement", 0.4)}, "inputs": {"F": 0.4}}
    A, B, C, _ = state_space(beam(0.8, boundary="pinned-pinned", **middle, **of))
    assert (C @ np.linalg.solve(-A, B)).item() == pytest.approx(0.8**3 / (48 * EI), rel=1e-5)


def test_sensors_of_all_kinds_and_their_units():
    kinds = ("displacement", "velocity", "acceleration", "strain")
    model = cantilever(
        sensors={k[0]: (k, 0.3) for k in kinds}, forces={"F": 0.2}, inputs={"U": 0.405}
    )
    assert [s.unit for s in model.outputs] == ["m", "m/s", "m/s2", ""]
    assert [s.unit for s in (*model.parameters, *model.inputs)] == ["N", "N"]
    assert model.theta == [0.0]
    A, B, C, D = state_space(forces_as_inputs(model, ["F"]))
    np.testing.assert_allclose(C[1], C[0] @ A, rtol=1e-12)
    np.testing.assert_allclose(C[2], C[1] @ A, rtol=1e-12)
    np.testing.assert_allclose(D, np.vstack([np.zeros((2, 2)), C[1:2] @ B, np.zeros((1, 2))]))


def test_a_free_beam_falls_and_turns():
    """A force at the end of a free beam of mass m: 4 F / m there, -2 F / m at the other end."""
    model = beam(
        0.5,
        boundary="free-free",
        modes=2,
        sensors={"here": ("acceleration", 0.0), "there": ("acceleration", 0.5)},
        inputs={"F": 0.0},
        **SIZE,
    )
    mass = 0.5 * SIZE["width"] * SIZE["thickness"] * SIZE["density"]
    np.testing.assert_allclose(state_space(model)[3][:, 0] * mass, [4.0, -2.0], rtol=1e-12)
    np.testing.assert_array_equal(hertz(model), 0.0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"forces": {"F": 0.41}}, r"force 'F' is at 0.41 m, off the beam, which goes .* 0.405 m"),
        ({"inputs": {"F": -0.1}}, "input 'F' is at -0.1 m, off the beam"),
        ({"sensors": {"s": ("displacement", 0.5)}}, "sensor 's' is at 0.5 m, off the beam"),
        (
            {"forces": {"F": 0.0}},
            "force 'F' at 0 m moves no mode: it is at a vibration node of all",
        ),
        ({"sensors": {"s": ("velocity", 0)}}, "sensor 's' at 0 m sees no mode: there is no velo"),
        ({"sensors": {"s": ("strain", 0.405)}}, "sensor 's' at 0.405 m sees no mode: .* no strain"),
        ({"sensors": {"s": ("accelaration", 0.1)}}, "did you mean 'acceleration'"),
        ({"sensors": {"s": 0.1}}, r"sensor 's' is 0.1; give \(kind, position\)"),
        ({"forces": {"F": "tip"}}, "force 'F' is at 'tip'; give a position"),
        ({"width": -0.1}, "width is -0.1; sizes must be positive"),
        ({"density": 0.0, "thickness": np.nan}, "thickness is nan, density is 0; sizes must"),
        ({"width": None}, "the cross-section lacks width"),
        ({"bending_stiffness": 1.0}, "bending_stiffness and width are both given"),
        ({"tip_mass": -1.0}, "tip_mass is -1 kg; it must not be negative"),
        ({"tip_mass": 1.0, "boundary": "free-free"}, "a tip mass needs a free end"),
        ({"boundary": "canti-lever"}, "unknown boundary 'canti-lever': did you mean 'cantilever'"),
        ({"modes": 0}, "number of modes is 0"),
        ({"modes": 2}, r"damping has the size \(3,\); give one number, or 2"),
        ({"damping": 1.5}, "damping ratio of mode 1 is 1.5; it must be from 0 to below 1"),
    ],
)
def test_bad_input_is_said(changes, message):
    with pytest.raises(ModelError, match=message):
        cantilever(**changes)


def test_direct_stiffness_lacks_one_half_or_the_thickness():
    direct = {"bending_stiffness": 3.0, "sensors": {"s": ("strain", 0.1)}}
    with pytest.raises(ModelError, match="lacks mass_per_length"):
        beam(0.4, **direct)
    with pytest.raises(ModelError, match="sensor 's' is a strain; give the thickness"):
        beam(0.4, **direct, mass_per_length=1.0)


def test_what_a_vibration_node_does_not_move_is_zero():
    """The middle is a node of the second mode of a pinned beam."""
    pinned = {"boundary": "pinned-pinned", "modes": 2, "damping": 0.01}
    middle = {"sensors": {"y": ("displacement", 0.2025)}, "inputs": {"F": 0.2025}}
    _, B, C, _ = state_space(cantilever(**pinned, **middle))
    assert B[2, 0] == C[0, 0] != 0
    assert B[3, 0] == C[0, 1] == 0


def test_sampling_too_slow_names_the_modes():
    model = cantilever()
    check_sampling(model, 1 / 400)
    with pytest.raises(ModelError, match=r"cannot carry: 153\.7 Hz \(q3, q3_dot\); .* is 150 Hz"):
        check_sampling(model, 1 / 300)
    with pytest.raises(ModelError, match=r"54\.88 Hz \(q2, q2_dot\), 153\.7 Hz \(q3, q3_dot\)"):
        check_sampling(model, 0.01)
    decaying = lti(
        [[-500.0]], [[1.0]], [[1.0]], states={"v": ""}, inputs={"u": ""}, outputs={"y": ""}
    )
    check_sampling(decaying, 0.1)
    check_sampling(duffing(k1=1e6, d=1.0, k3=1.0), 0.1)

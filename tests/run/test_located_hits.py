"""Hits between the places and the samples, on beams that are simulated by other routes."""

import dataclasses
import functools

import numpy as np
import pytest
from scipy.linalg import expm

import backsight as bs
from backsight.errors import DataError, TuningError
from backsight.models.lti import state_space

DT, FINE = 1 / 400, 40
PLACES = tuple(round(0.125 + 0.04 * i, 3) for i in range(8))
NAMES = tuple(f"F{i}" for i in range(8))
LINE = bs.forces.ForceLine(PLACES, supports=(0.0,))
HITS = ((0.232, 6.3, 2.6, 7.0), (0.351, 17.6, 1.8, -6.0))
"""Place [m], beginning and duration [samples], height [N] of half-sines."""


def beam(forces):
    return bs.beam(
        0.405, width=0.025, thickness=0.003, youngs_modulus=65.9e9, density=7502.0,
        damping=[0.030, 0.037, 0.119], forces=forces,
        sensors={f"s{i}": ("displacement", x) for i, x in enumerate((0.245, 0.325, 0.405))},
    )  # fmt: skip


def struck(course, sigma=1e-5, samples=32):
    """Beam with its exact mode shapes where it is struck, in steps of a 40th of a sample."""
    moments = (np.arange(samples * FINE) + 0.5) / FINE
    y = sigma * np.random.default_rng(3).standard_normal((samples, 3))
    for place, start, width, size in HITS:
        A, B, C, _ = state_space(bs.forces.forces_as_inputs(beam({"F": place}), ["F"]))
        grown = expm(DT / FINE * np.block([[A, B], [np.zeros((1, 7))]]))
        s, x = (moments - start) / width, np.zeros(6)
        force = np.where((s > 0) & (s < 1), size * course(np.clip(s, 0, 1)), 0.0)
        for k in range(samples):
            y[k] += C @ x
            for f in force[k * FINE : (k + 1) * FINE]:
                x = grown[:6, :6] @ x + grown[:6, 6] * f
    return bs.from_arrays(
        u=np.zeros((samples, 0)),
        y=y,
        dt=DT,
        inputs={},
        outputs=dict.fromkeys(("s0", "s1", "s2"), "m"),
    )


METHOD = bs.CompressiveSensingMHE(
    noise=bs.Noise(sigma_y=1e-5), prior=bs.Prior(sigma_x0=1e-4), forces=NAMES, sigma_force=0.02,
    lam=17.0, dictionary=bs.forces.HalfSines((1, 2, 3)),
)  # fmt: skip
MODEL = beam(dict(zip(NAMES, PLACES, strict=True)))
half_sines = functools.cache(lambda: struck(lambda s: np.sin(np.pi * s)))
found_half_sines = functools.cache(
    lambda: bs.forces.find_sparse_forces(METHOD, MODEL, half_sines())
)


def assert_located(hits, shape=2 / np.pi):
    """At most a tenth of the distance of two places and of a sample away, and bands that hold."""
    assert hits.sizes["hit"] == len(HITS)
    for i, (place, start, width, size) in enumerate(HITS):
        hit = hits.isel(hit=i)
        assert abs(hit["place"] - place) < 0.1 * 0.04
        assert abs(hit["time"] - DT * (start + width / 2)) < 0.1 * DT
        impulse = size * width * DT * shape
        assert abs(hit["impulse"] / impulse - 1) < 0.05
        true = {"place": place, "time": DT * (start + width / 2), "impulse": impulse}
        for name, value in true.items():
            assert 0 < abs(hit[name] - value) < 4 * hit[f"{name}_std"]


def test_hits_are_located_between_places_and_samples():
    hits = bs.forces.locate_hits(METHOD, MODEL, half_sines(), found_half_sines(), line=LINE)
    assert_located(hits)
    np.testing.assert_allclose(hits["size"], [h[3] for h in HITS], rtol=0.15)
    assert hits.attrs["chi2"] < hits.attrs["measured"] < found_half_sines().attrs["chi2"] * 1.5


def test_hits_of_the_window_are_located_too():
    found = bs.estimate(METHOD, MODEL, half_sines(), engine="vm")
    assert_located(bs.forces.locate_hits(METHOD, MODEL, half_sines(), found, line=LINE))


def test_a_known_sign_is_kept():
    """Only the hit upwards is left; the other one is no reason for a third."""
    method = dataclasses.replace(METHOD, nonnegative=NAMES)
    hits = bs.forces.locate_hits(method, MODEL, half_sines(), found_half_sines(), line=LINE)
    assert (hits["size"] >= 0).all()


def test_soft_hits():
    method = dataclasses.replace(METHOD, dictionary=bs.forces.Haversines((2, 3)))
    recording = struck(lambda s: np.sin(np.pi * s) ** 2)
    found = bs.forces.find_sparse_forces(method, MODEL, recording)
    assert_located(bs.forces.locate_hits(method, MODEL, recording, found, line=LINE), shape=0.5)


LENGTH, BRIDGE_DT, CROSSING = 20.0, 0.01, -117.3
NODES = tuple(np.linspace(2.5, 17.5, 7).tolist())


@functools.cache
def crossed():
    """Three modes of a bridge, sines, with accelerometers; one load of 12 kN, 20 dB."""
    w = (np.arange(1, 4) * np.pi / LENGTH) ** 2 * np.sqrt(4e9 / 3000)
    A = np.block([[np.zeros((3, 3)), np.eye(3)], [-np.diag(w**2), -0.04 * np.diag(w)]])
    B = np.vstack([np.zeros((3, 3)), np.eye(3)])
    grown = expm(BRIDGE_DT / 20 * np.block([[A, B], [np.zeros((3, 9))]]))

    def shape(x):
        return np.sqrt(2 / (3000 * LENGTH)) * np.sin(np.arange(1, 4) * np.pi * x / LENGTH)

    def force(moment):
        gone = (moment - 8.4) / abs(CROSSING)
        return -12e3 * shape(LENGTH * (1 - gone)) if 0 < gone < 1 else np.zeros(3)

    seen, x, y = np.array([shape(p) for p in (5.0, 10.0, 14.0)]), np.zeros(6), []
    for k in range(150):
        y.append(seen @ (A[3:] @ x + force(k)))
        for i in range(20):
            x = grown[:6, :6] @ x + grown[:6, 6:] @ force(k + (i + 0.5) / 20)
    sigma = 0.1 * np.std(y, axis=0)
    y = np.array(y) + sigma * np.random.default_rng(1).standard_normal((150, 3))
    outputs = dict.fromkeys("abc", "m/s2")
    recording = bs.from_arrays(u=np.zeros((150, 0)), y=y, dt=BRIDGE_DT, inputs={}, outputs=outputs)
    return recording, dict(zip("abc", sigma.tolist(), strict=True))


def test_a_load_crosses_a_bridge():
    recording, sigma = crossed()
    names = tuple(f"P{i}" for i in range(len(NODES)))
    bridge = bs.beam(
        LENGTH, boundary="pinned-pinned", bending_stiffness=4e9, mass_per_length=3000, damping=0.02,
        sensors={n: ("acceleration", x) for n, x in zip("abc", (5.0, 10.0, 14.0), strict=True)},
        forces=dict(zip(names, NODES, strict=True)),
    )  # fmt: skip
    line = bs.forces.ForceLine(NODES, supports=(0.0, LENGTH))
    method = bs.CompressiveSensingMHE(
        noise=bs.Noise(sigma_y=sigma), prior=bs.Prior(sigma_x0=1e-3), forces=names, lam=1.0,
        sigma_force=20.0, dictionary=bs.forces.MovingLoads(line, (110, -110, -130)),
    )  # fmt: skip
    found = bs.forces.find_sparse_forces(method, bridge, recording)
    loads = bs.forces.locate_hits(method, bridge, recording, found)
    assert loads.sizes["hit"] == 1
    speed = LENGTH / (CROSSING * BRIDGE_DT)
    assert abs(loads["speed"][0] / speed - 1) < 0.02
    assert abs(loads["size"][0] / -12e3 - 1) < 0.05
    assert abs(loads["speed"][0] - speed) < 4 * loads["speed_std"][0]
    assert loads["place"][0] == LENGTH


def test_what_does_not_fit_is_refused():
    found = found_half_sines()

    def locate(method=METHOD, model=MODEL, recording=None, result=found, line=LINE):
        recording = half_sines() if recording is None else recording
        return bs.forces.locate_hits(method, model, recording, result, line=line)

    with pytest.raises(TuningError, match="line = ForceLine"):
        locate(line=None)
    with pytest.raises(TuningError, match="7 places; there are 8 forces"):
        locate(line=bs.forces.ForceLine(PLACES[:7]))
    atoms = dataclasses.replace(METHOD, dictionary=bs.forces.Atoms(np.eye(8)))
    with pytest.raises(TuningError, match="Atoms does not say what a hit looks like"):
        locate(method=atoms)
    loads = dataclasses.replace(METHOD, dictionary=bs.forces.MovingLoads(LINE, (20,)))
    with pytest.raises(TuningError, match="leave it out"):
        locate(method=loads, line=bs.forces.ForceLine(PLACES))
    with pytest.raises(TuningError, match="only some of the forces have a known sign"):
        locate(method=dataclasses.replace(METHOD, nonnegative=("F1",)))
    with pytest.raises(DataError, match="no result with the forces"):
        locate(result=found.drop_vars("d_hat"))
    with pytest.raises(DataError, match="has 31 samples; the recording has 32"):
        locate(result=found.isel(time=slice(31)))
    with pytest.raises(DataError, match="nothing to locate"):
        locate(result=found.assign(d_hat=0 * found["d_hat"]))
    with pytest.raises(TuningError, match="is in discrete time"):
        locate(model=dataclasses.replace(MODEL, dt=DT))

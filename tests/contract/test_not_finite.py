"""What is not finite says so in the recursion itself, and starts anew if that is wanted."""

import subprocess

import casadi as ca
import numpy as np
import pytest

import backsight as bs
from backsight.engine import native, vm
from backsight.export import export_c
from backsight.schema import Status

DT = 0.1
ENGINES = {"vm": vm.run, "native": native.run}


def exploding() -> bs.Model:
    """The state goes off like a tangent once it is far out; the output is its square."""
    return bs.Model(
        f=lambda x, u, p: [x.v + u.F, 1e-2 * x.q**3 * ca.exp(x.v)],
        h=lambda x, u, p: [x.q * (1 + x.q)],
        states={"q": "", "v": ""},
        inputs={"F": ""},
        outputs={"y": ""},
    )


NOISE, PRIOR = bs.Noise(sigma_y=0.1, sigma_w=0.1), bs.Prior(sigma_x0=1.0)
STEP = bs.Integrator("rk4", 1)
METHODS = {
    "ekf": bs.EKF(NOISE, PRIOR, STEP),
    "iekf": bs.IEKF(NOISE, PRIOR, STEP),
    "ukf": bs.UKF(NOISE, PRIOR, STEP),
    "mho": bs.MHO(NOISE, PRIOR, N=3, integrator=STEP),
    "mhe": bs.MHE(NOISE, PRIOR, N=3, integrator=STEP),
    "bucy": bs.EKF(NOISE, PRIOR, STEP, measurement="continuous"),
}


def wild(n: int = 300) -> list[np.ndarray]:
    """Random samples, some of them of any size."""
    rng = np.random.default_rng(0)
    size = np.where(rng.random((n, 2)) < 0.1, 10.0 ** rng.uniform(-2, 160, (n, 2)), 1.0)
    u, y = (size * rng.standard_normal((n, 2))).T[:, :, None]
    return [u, y, (rng.random((n, 1)) < 0.8).astype(float)]


def named(recursion, engine, data):
    _, outputs = ENGINES[engine](recursion, data, carry=recursion.carry0)
    return {c.name: c.unpack(o) for c, o in zip(recursion.channels, outputs, strict=True)}


@pytest.mark.parametrize("method", METHODS)
def test_the_status_of_every_sample_tells(method):
    recursion = METHODS[method].compile(exploding(), DT)
    for made in (recursion, recursion.restarting()):
        found = named(made, "vm", wild())
        variance = np.diagonal(found["P"], axis1=1, axis2=2)
        finite = np.isfinite(found["x_hat"]).all(axis=1) & np.isfinite(variance).all(axis=1)
        told = (found["status"].astype(int) & Status.NOT_FINITE) != 0
        assert np.isfinite(found["status"]).all()
        assert told[~finite].all()
        assert told.any()
        if made is recursion:
            assert (told == ~finite).all()
    # Started anew, most samples are fine.
    assert finite.sum() > 250
    assert told.sum() < 100


@pytest.mark.parametrize("engine", ENGINES)
def test_started_anew_it_is_as_at_the_first_sample(engine):
    recursion = METHODS["ekf"].compile(exploding(), DT)
    u, y, mask = wild()
    found = named(recursion.restarting(), engine, [u, y, mask])
    failed = np.flatnonzero(found["status"].astype(int) & Status.NOT_FINITE)
    k = int(failed[0])
    fresh = named(recursion, engine, [u[k + 1 : k + 3], y[k + 1 : k + 3], mask[k + 1 : k + 3]])
    np.testing.assert_array_equal(found["x_hat"][k + 1 : k + 3], fresh["x_hat"])
    lost = named(recursion, engine, [u, y, mask])
    assert not np.isfinite(lost["x_hat"][k + 1 :]).all(axis=1).any()


def test_estimates_and_streams_start_anew():
    u, y, mask = wild(60)
    recording = bs.from_arrays(
        u=u, y=np.where(mask > 0, y, np.nan), inputs={"F": ""}, outputs={"y": ""}, dt=DT
    )
    given = METHODS["ekf"], exploding()
    with pytest.raises(bs.errors.EstimationError):
        bs.estimate(*given, recording, engine="vm")
    result = bs.estimate(*given, recording, engine="vm", restart=True)
    stream = bs.stream(*given, dt=DT, engine="vm", restart=True)
    told = [stream.step(u[k], np.where(mask[k] > 0, y[k], np.nan))["status"] for k in range(60)]
    # A result looks at the modes along the estimates, too, and at values that are absurd.
    later = int(Status.COARSE_STEP | Status.NOT_FINITE)
    said = np.array([int(s) for s in told])
    assert (result["status"].values & ~later).tolist() == (said & ~later).tolist()
    assert not (said & Status.NOT_FINITE & ~result["status"].values).any()
    assert 0 < ((result["status"].values & Status.NOT_FINITE) > 0).sum() < 50


@pytest.mark.parametrize("restart", [False, True])
def test_exported_code_tells_too(tmp_path, restart):
    """The unscented Kalman filter in C, on the same samples."""
    quiet = bs.from_arrays(
        u=np.zeros((20, 1)), y=np.zeros(20), inputs={"F": ""}, outputs={"y": ""}, dt=DT
    )
    export_c(METHODS["ukf"], exploding(), quiet, tmp_path, name="ukf", restart=restart)
    u, y, mask = wild()
    rows = np.hstack([u, y, mask])
    body = "\n".join("{" + ", ".join(f"{v:.17g}" for v in row) + "}," for row in rows)
    (tmp_path / "main.c").write_text(
        '#include <stdio.h>\n#include "ukf.h"\n'
        f"static const double rows[][3] = {{{body}}};\n"
        "int main(void) {\n"
        "  static ukf_memory m; static ukf_workspace w; static ukf_settings s;\n"
        "  double x[2], P[3], y, e, S, status;\n  ukf_init(&m);\n"
        "  ukf_defaults(&s);\n"
        f"  for (int k = 0; k < {len(rows)}; k++) {{\n"
        "    const double *d = rows[k];\n"
        "    ukf_step(&m, &w, &s, &d[0], &d[1], &d[2], x, P, &y, &e, &S, &status);\n"
        '    printf("%.17g %.17g\\n", x[0], status);\n  }\n  return 0;\n}\n'
    )
    subprocess.run(
        ["cc", "-O1", "-std=c99", "-o", "main", "main.c", "ukf.c", "-lm"], cwd=tmp_path, check=True
    )
    printed = subprocess.run(["./main"], cwd=tmp_path, check=True, capture_output=True, text=True)
    found = np.array([[float(v) for v in line.split()] for line in printed.stdout.splitlines()])
    told = (found[:, 1].astype(int) & Status.NOT_FINITE) != 0
    assert told[~np.isfinite(found[:, 0])].all()
    assert 0 < told.sum() < (150 if restart else len(told))

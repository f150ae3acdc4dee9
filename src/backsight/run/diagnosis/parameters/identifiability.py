"""How well a recording will tell the constant parameters, before anything is estimated."""

import dataclasses

import numpy as np
import xarray as xr

from backsight.analysis.observability import STEP, ExpectedBand, Identifiability, flat_directions
from backsight.description import checked
from backsight.engine.execute import choose_engine, run_recursion
from backsight.errors import ModelError
from backsight.estimators import yardstick
from backsight.estimators.base import AbstractEstimator
from backsight.models.model import Model
from backsight.run.diagnosis._free_forces import constants_and_forces, with_walks
from backsight.run.estimation import match
from backsight.types import Array

ENTRIES = 5_000_000
"""Entries of covariances that are computed at most: with many states, of the first samples."""


@checked()
def check_identifiability(
    estimator: AbstractEstimator, model: Model, recording: xr.Dataset
) -> Identifiability:
    """Foretell the bands of constant parameters, and whether an unknown force can explain them.

    The model moves from its prior under the recorded inputs, and an extended Kalman filter with the
    estimator's noise and prior measures that very motion: its covariance is the bound for every
    estimator along it. The same without the walks of unknown forces, and with larger ones. Where no
    recorded input moves the model, as on a road or in the wind, the motion is the measured one.

    Parameters
    ----------
    estimator : AbstractEstimator
        Its noise and prior are used.
    model : Model
        As for the estimator, with what is unknown among its states. Parameters that walk are
        counted as forces.
    recording : xarray.Dataset
        Its inputs, and which outputs were measured at which samples.

    Returns
    -------
    Identifiability

    Raises
    ------
    DataError
        If recording and model do not fit.
    TuningError, ModelError
        If estimator and model do not fit, or the motion does not stay finite.

    Examples
    --------
    >>> import numpy as np
    >>> spring, u = bs.sdof(k=40.0, b=0.8), np.random.default_rng(0).standard_normal((100, 1))
    >>> joint = bs.augment(spring, parameters=["k"])
    >>> recording = bs.simulate(spring, u, dt=0.05, sigma_y=1e-4, seed=1)
    >>> ekf = bs.EKF(
    ...     bs.Noise(sigma_y=1e-4, sigma_w={"q": 1e-6, "v": 1e-6}),
    ...     bs.Prior(sigma_x0={"q": 0.1, "v": 0.1, "k": 5.0}),
    ... )
    >>> [band.name for band in bs.check.check_identifiability(ekf, joint, recording).parameters]
    ['k']
    """
    judge = yardstick(estimator, model)
    noise, prior = judge.assumed
    dt = float(recording.attrs["dt"])
    constants, forces = constants_and_forces(model, noise)
    most = max(ENTRIES // model.nx**2, 1)
    u, y, mask = (part[:most] for part in match(model, recording, estimator=judge))
    before = np.sqrt(np.diag(prior.covariance(model)))[constants]
    of = [model.states[i] for i in constants]
    if not of:
        return Identifiability(len(u), (), tuple(model.states[i].name for i in forces), ())
    motion = y
    if np.ptp(u, axis=0).any():
        # A filter that measures nothing simulates; one that measures what it simulates stays there.
        motion = _filtered(judge, model, dt, [u, np.zeros_like(y), np.zeros_like(mask)])["y_hat"]
    found = {}
    for factor in (1.0, 0.0, STEP) if len(forces) else (1.0,):
        walks = with_walks(noise, model, forces=forces, factor=factor)
        filtered = _filtered(dataclasses.replace(judge, noise=walks), model, dt, [u, motion, mask])
        found[factor] = filtered["P"][-1][np.ix_(constants, constants)]
    if not all(np.isfinite(P).all() for P in found.values()):
        raise ModelError(f"the motion of model '{model.name}' from its prior does not stay finite")
    std = {factor: np.sqrt(np.maximum(np.diag(P), 0.0)) for factor, P in found.items()}
    without, wider = std.get(0.0, std[1.0]), std.get(STEP, std[1.0])
    return Identifiability(
        samples=len(u),
        parameters=tuple(
            ExpectedBand(s.name, s.unit, *map(float, bands))
            for s, *bands in zip(of, before, std[1.0], without, wider, strict=True)
        ),
        forces=tuple(model.states[i].name for i in forces),
        flat=flat_directions(found[1.0], before, of),
    )


def _filtered(
    judge: AbstractEstimator, model: Model, dt: float, data: list[Array]
) -> dict[str, Array]:
    recursion = judge.compile(model, dt)
    outputs = run_recursion(recursion, data, engine=choose_engine(None, len(data[0])))
    return {c.name: c.unpack(o) for c, o in zip(recursion.channels, outputs, strict=True)}

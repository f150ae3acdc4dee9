"""Hits in a recording of a nonlinear model, such as one whose sensors come to their limits."""

import xarray as xr

from backsight.description import Count, Positive, Share, checked
from backsight.estimators.force_estimator import AbstractForceEstimator
from backsight.models.model import Model
from backsight.run.following._task import ready_to_follow


@checked()
def follow_hits(
    estimator: AbstractForceEstimator,
    model: Model,
    recording: xr.Dataset,
    *,
    sizes: tuple[Positive, Positive],
    before: Count,
    after: Count,
    beside: tuple[str, ...] = (),
    alarm: Positive = 10.0,
    gain: Share = 0.5,
) -> xr.Dataset:
    r"""Find hits one by one in a recording of a nonlinear model.

    For models in which no linearisation leads to a hit: accelerometers that a hit drives to their
    limits, stops, dry friction. An extended Kalman filter follows the recording. Where the
    measurements surprise it, hits at all forces, of all sizes, moments and widths are tried by the
    equations themselves in a window around that moment; from the best few of every force, the
    first state of the window and the hit are fitted together (Gauss-Newton in a trust region). The
    force that explains most is the one, if it explains enough; the filter goes on behind it.

    A pulse shorter than a sample is no matter of linear models, but of the limits of sensors it is:
    take a model in parts of a sample, and a recording in which the other parts are not measured
    (``NaN``). So channels that are read one after the other have their own moments, too.

    Parameters
    ----------
    estimator : AbstractForceEstimator
        For what is known of noise, prior and forces: `noise`, `prior`, `forces`, `sigma_force` (of
        the filter between the hits), `nonnegative`, `nonpositive`, and the `dictionary`, pulses as
        `HalfSines` that give the course, and the widths between the smallest and largest of which
        a hit has its own. All that is about windows and weights is not used.
    model : Model
    recording : xarray.Dataset
    sizes : (float, float)
        Smallest and largest height of a pulse that is tried [unit of the forces]; the fit may go
        beyond.
    before, after : int
        Samples of a window before and after the alarm. Before it there should be enough to know the
        motion; after it as much as the modes need to tell the places apart.
    beside : tuple of str
        Forces that a hit may move at the same time, wherever it is, such as a moment about the axis
        of a beam; they are no places.
    alarm : float
        Mean of the squared innovations, by their variances, over a pulse, at which it is looked
        for a hit. Without hits it is one if the noise is as stated.
    gain : float
        Share of what a window leaves without a hit that one must explain to be believed.

    Returns
    -------
    xarray.Dataset
        By ``hit``: ``force``, its name; ``time``, the centre of gravity of the pulse, and
        ``start`` [s]; ``size``, its height, ``impulse`` and ``width`` [s], each with
        ``<name>_std``; ``explained``, the share of the window's cost that the hit explains;
        ``rival``, the cost of the best hit at another force over that of the best, the evidence
        for the place; and ``beside (hit, moved)``, the heights of the forces beside it. Deviations
        count what the window leaves as noise. A window has one hit: what bounces is one, too.

    Raises
    ------
    TuningError
        If the dictionary is not one of pulses, a name of `beside` is no force, or no force is left.
    DataError
        If recording and model do not fit.

    Examples
    --------
    A mass on a spring, whose accelerometer sees no more than 4 m/s²:

    >>> import numpy as np
    >>> spring = bs.Model(
    ...     f=lambda x, u, p: [x.v, p.F - 400.0 * x.q - 2.0 * x.v],
    ...     h=lambda x, u, p: [p.F - 400.0 * x.q - 2.0 * x.v],
    ...     states={"q": "m", "v": "m/s"}, inputs={}, outputs={"a": "m/s2"},
    ...     parameters={"F": (0.0, "N")},
    ... )
    >>> seen = bs.models.with_sensors(spring, {"a": bs.models.Sensor(limit=4.0)})
    >>> struck = np.zeros((150, 1))
    >>> struck[[60, 61], 0] = 20.0
    >>> recording = bs.simulate(
    ...     bs.forces.forces_as_inputs(seen, ["F"]), struck, dt=0.01, sigma_y=0.02, seed=1
    ... )
    >>> method = bs.CompressiveSensingMHE(
    ...     noise=bs.Noise(sigma_y=0.02), prior=bs.Prior(sigma_x0=1e-3), forces=("F",), lam=1.0,
    ...     sigma_force=0.01, dictionary=bs.forces.HalfSines((2, 3)),
    ... )
    >>> hits = bs.forces.follow_hits(
    ...     method, seen, recording, sizes=(5.0, 80.0), before=30, after=40
    ... )
    >>> round(float(hits["impulse"][0]), 2)  # [N s]
    0.4
    """
    task = ready_to_follow(
        estimator,
        model,
        recording,
        sizes=sizes,
        before=before,
        after=after,
        beside=beside,
        alarm=alarm,
        gain=gain,
    )
    return task.table(task.follow(lambda _: None).hits)

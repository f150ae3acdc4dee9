"""What a user has chosen on the page."""

import pydantic

from backsight.problem.reading.tables import StrictTable

METHODS = {
    "MHE": 'kind = "mhe"\nN = 20',
    "EKF": 'kind = "ekf"',
    "UKF": 'kind = "ukf"',
    "Smoothed": 'kind = "ekf"\nsmooth = true',
}
"""Name of an estimator on the page to its table in the problem file.

The first one is chosen at first: it stands guesses that are far off, where the filters are
over-confident for a while.
"""


class Quantity(StrictTable):
    """A constant or a load: known, constant and unknown, or wandering.

    `value` is its value or the guess, `sigma` how wrong that may be (None: it is known), `change`
    by how much it may change within a second.
    """

    value: float
    sigma: float | None = pydantic.Field(default=None, gt=0)
    change: float = pydantic.Field(default=0.0, ge=0)
    lower: float | None = None
    unit: str = pydantic.Field(default="", max_length=50)


class Choices(StrictTable):
    """Everything on the page that makes a problem file.

    `inputs` and `outputs` are signals of the model with their columns, `noise` the standard
    deviation of every output [its unit], `equations` the text of the user's own model.
    """

    title: str = pydantic.Field(default="", max_length=200)
    machine: str
    equations: str = pydantic.Field(default="", max_length=20_000)
    inputs: dict[str, str] = pydantic.Field(default_factory=dict)
    outputs: dict[str, str] = pydantic.Field(default_factory=dict)
    quantities: dict[str, Quantity] = pydantic.Field(default_factory=dict)
    noise: dict[str, float] = pydantic.Field(default_factory=dict)
    methods: list[str] = pydantic.Field(default_factory=lambda: list(METHODS)[:1])
    time: str | None = None
    dt: float | None = pydantic.Field(default=None, gt=0)

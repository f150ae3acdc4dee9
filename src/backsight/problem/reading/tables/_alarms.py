"""What a problem file says of alarms while samples come."""

from collections.abc import Mapping

import pydantic

from backsight.problem.reading.tables._strict import StrictTable
from backsight.problem.reading.tables._topic import TopicTable


class AlarmTable(StrictTable):
    """``[alarm.NAME]``: when it is raised, and who is told.

    Parameters
    ----------
    hold : float
        Time that it must last before the alarm is raised, and be over before it is cleared [s].
    command : list of str
        Program with its arguments that is started for every alarm; it gets the alarm as JSON.
    webhook : str
        Address to which every alarm is sent as JSON.
    mqtt : table
        Broker and topic to which every alarm is published as JSON.
    """

    kind: str
    hold: float = pydantic.Field(default=0.0, ge=0)
    command: list[str] = pydantic.Field(default_factory=list)
    webhook: str = pydantic.Field(default="", pattern=r"^(https?://.+)?$")
    mqtt: TopicTable | None = None


class RangeAlarm(AlarmTable):
    """A quantity leaves a range, band and all.

    Parameters
    ----------
    of : str
        State, parameter, virtual quantity or output.
    lower, upper : float
        Ends of the range [unit].
    sigmas : float
        Standard deviations by which it must be beyond an end.
    hysteresis : float
        By how much it must be back inside before the alarm is cleared [unit].
    """

    of: str
    lower: float | None = None
    upper: float | None = None
    sigmas: float = pydantic.Field(default=2.0, ge=0)
    hysteresis: float = pydantic.Field(default=0.0, ge=0)


class NisAlarm(AlarmTable):
    """The innovations are larger or smaller than the estimator believes.

    Parameters
    ----------
    over : float
        Time over which the mean is taken [s].
    level : float
        Share of the time for which a sound estimator stays inside.
    factor : float
        What does no harm: a mean between this and its inverse is never told.
    """

    over: float = pydantic.Field(default=10.0, gt=0)
    level: float = pydantic.Field(default=0.9999, gt=0, lt=1)
    factor: float = pydantic.Field(default=1.5, ge=1)


class HitAlarm(AlarmTable):
    """An unknown force or disturbance is larger than a threshold: a hit, with place and size.

    Parameters
    ----------
    threshold : float
        Size from which on it is a hit [unit of the force].
    of : list of str
        Forces or disturbances; all if not given.
    sigmas : float
        Standard deviations by which it must also be beyond zero.
    false_alarms : float
        Per hour, that are accepted. A hit is then told once, when it is over, with its time,
        impulse and the probability that noise made it, see `announce_hits`; sigmas does not count.
    """

    threshold: float = pydantic.Field(gt=0)
    of: list[str] = pydantic.Field(default_factory=list)
    sigmas: float = pydantic.Field(default=3.0, ge=0)
    false_alarms: float | None = pydantic.Field(default=None, gt=0)


class SilentAlarm(AlarmTable):
    """A sensor brings nothing.

    Parameters
    ----------
    of : list of str
        Outputs; all if not given.
    after : float
        Time without a sample [s].
    """

    of: list[str] = pydantic.Field(default_factory=list)
    after: float = pydantic.Field(default=5.0, gt=0)


class StatusAlarm(AlarmTable):
    """The estimator reports something.

    Parameters
    ----------
    bits : list of str
        What, such as not_finite or clipped.
    """

    bits: list[str] = pydantic.Field(min_length=1)


ALARMS: Mapping[str, type[AlarmTable]] = {
    "range": RangeAlarm,
    "nis": NisAlarm,
    "hit": HitAlarm,
    "silent": SilentAlarm,
    "status": StatusAlarm,
}
"""Kind of an alarm to its table."""

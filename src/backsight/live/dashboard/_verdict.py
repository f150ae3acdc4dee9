"""The light of the dashboard: one colour, and the sentence that says why."""

import math
from typing import Literal

import numpy as np

from backsight.live._session import LiveSession
from backsight.live._status import LiveStatus
from backsight.schema import Status

Light = Literal["good", "doubt", "bad"]

_WIDE = 2.0
"""Mean NIS by the number of outputs beyond which bands are not believed, or below its inverse."""


def verdict(session: LiveSession, status: LiveStatus) -> tuple[Light, str]:
    """Return the light and the sentence: what is worst comes first."""
    if session.alarms is not None:
        raised = [a for a in session.alarms.alarms.values() if a.raised]
        if raised:
            return "bad", f"Alarm {raised[0].name}: {raised[0].sentence}."
    silent = [lane for lane in session.lanes if lane.silent(status.now)]
    if silent:
        seconds = silent[0].silent_for(status.now)
        return "bad", f"Source {silent[0].name} has been silent for {seconds:.0f} s."
    newest = session.newest
    if newest is None:
        return "doubt", "Nothing has been measured yet."
    if int(newest.values["status"][-1]) & Status.NOT_FINITE:
        return "bad", "The estimator diverged and begins anew."
    if session.keeper is not None and session.keeper.failure:
        return "bad", f"Results cannot be stored: {session.keeper.failure}"
    if session.freezer is not None and session.freezer.frozen.any():
        names = ", ".join(np.array(session.freezer.names)[session.freezer.frozen])
        return "doubt", f"{names} cannot be seen in this motion and is frozen."
    nis = status.nis
    if math.isnan(nis):
        return "doubt", "No output has been measured lately."
    if nis > _WIDE:
        return "doubt", f"The innovations are larger than the bands allow (NIS {nis:.2f})."
    if nis < 1 / _WIDE:
        return "doubt", f"The bands are wider than the innovations need (NIS {nis:.2f})."
    return "good", f"The innovations are as large as the bands say (NIS {nis:.2f})."

"""From samples as they come to estimates, a store and a dashboard: ``backsight live``.

Sources receive in the background; every half block the samples are put on one grid, the estimator
runs over them as machine code, and what can no longer change goes to the store.
"""

from backsight.live._opening import opened_session as opened_session
from backsight.live._problem import load_live as load_live
from backsight.live._ready import made_ready as made_ready
from backsight.live._session import LiveSession as LiveSession
from backsight.live.running import run_live as run_live

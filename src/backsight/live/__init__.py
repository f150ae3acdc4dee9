"""From samples as they come to estimates, a store and a dashboard: ``backsight live``.

Sources receive in the background; every half block the samples are put on one grid, the estimator
runs over them as machine code, and what can no longer change goes to the store.
"""

from backsight.live.running import run_live as run_live

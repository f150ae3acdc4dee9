"""An estimator over recordings, streams and windows."""

from backsight.run.estimation._estimate import Task as Task
from backsight.run.estimation._estimate import carry_out as carry_out
from backsight.run.estimation._estimate import check_memory as check_memory
from backsight.run.estimation._estimate import check_window as check_window
from backsight.run.estimation._estimate import estimate as estimate
from backsight.run.estimation._estimate import failure as failure
from backsight.run.estimation._estimate import ready as ready
from backsight.run.estimation._match import match as match
from backsight.run.estimation._match import matched_inputs as matched_inputs
from backsight.run.estimation._match import measured_outputs as measured_outputs
from backsight.run.estimation._mhe_window import solve_window as solve_window
from backsight.run.estimation._smooth import SmoothingTask as SmoothingTask
from backsight.run.estimation._smooth import carry_out_smoothing as carry_out_smoothing
from backsight.run.estimation._smooth import ready_to_smooth as ready_to_smooth
from backsight.run.estimation._smooth import smooth as smooth
from backsight.run.estimation._stream import stream as stream
from backsight.run.estimation.lag import run_on as run_on
from backsight.run.estimation.many import estimate_many as estimate_many
from backsight.run.estimation.result import as_result as as_result

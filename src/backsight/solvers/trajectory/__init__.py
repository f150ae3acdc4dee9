"""Trajectories with process noise and limits: iterated smoothers and active sets."""

from backsight.solvers.trajectory._active import solve as solve
from backsight.solvers.trajectory._iterated import iterated as iterated
from backsight.solvers.trajectory._iterated import select as select
from backsight.solvers.trajectory._mistaken import mistaken as mistaken
from backsight.solvers.trajectory._smoothed import smoothed as smoothed
from backsight.solvers.trajectory._smoothed import smoothed_all as smoothed_all
from backsight.solvers.trajectory.chain import Chain as Chain
from backsight.solvers.trajectory.chain import by_name as by_name
from backsight.solvers.trajectory.smoother import end_covariance as end_covariance
from backsight.solvers.trajectory.smoother import transit as transit
from backsight.solvers.trajectory.smoother import update as update

"""Recordings from models, in open and closed loop."""

from backsight.run.simulation._measured import measured_recording as measured_recording
from backsight.run.simulation._simulate import simulate as simulate
from backsight.run.simulation.closed_loop import simulate_closed_loop as simulate_closed_loop

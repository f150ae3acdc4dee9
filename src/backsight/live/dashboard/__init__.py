"""A page in the browser that shows a run: curves, a verdict, alarms, sources."""

from backsight.live.dashboard._board import Board as Board
from backsight.live.dashboard.serving import Place as Place
from backsight.live.dashboard.serving import placed_board as placed_board
from backsight.live.dashboard.serving import served_board as served_board

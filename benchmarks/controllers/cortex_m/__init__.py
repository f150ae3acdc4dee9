"""Programs for Cortex-M processors, and their emulator."""

from benchmarks.controllers.cortex_m.board import BOARDS as BOARDS
from benchmarks.controllers.cortex_m.board import Board as Board
from benchmarks.controllers.cortex_m.board import Counted as Counted

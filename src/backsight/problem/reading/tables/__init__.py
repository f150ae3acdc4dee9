"""The tables of a problem file: which keys there are and what they hold."""

from backsight.problem.reading.tables._recorded import ColumnTable as ColumnTable
from backsight.problem.reading.tables._recorded import CommandColumnTable as CommandColumnTable
from backsight.problem.reading.tables._recorded import FileTable as FileTable
from backsight.problem.reading.tables._recorded import RecordingTable as RecordingTable
from backsight.problem.reading.tables._recorded import SensorColumnTable as SensorColumnTable
from backsight.problem.reading.tables._recorded import SourceTable as SourceTable
from backsight.problem.reading.tables._strict import ShortTable as ShortTable
from backsight.problem.reading.tables._strict import StrictTable as StrictTable
from backsight.problem.reading.tables._unknowns import DisturbanceTable as DisturbanceTable
from backsight.problem.reading.tables._unknowns import DummyTable as DummyTable
from backsight.problem.reading.tables._unknowns import EstimateTable as EstimateTable
from backsight.problem.reading.tables._unknowns import ForceTable as ForceTable
from backsight.problem.reading.tables._unknowns import GapsTable as GapsTable
from backsight.problem.reading.tables._unknowns import MovingTable as MovingTable
from backsight.problem.reading.tables._unknowns import VirtualTable as VirtualTable
from backsight.problem.reading.tables._whole import EstimatorTable as EstimatorTable
from backsight.problem.reading.tables._whole import FreeTable as FreeTable
from backsight.problem.reading.tables._whole import NoiseTable as NoiseTable
from backsight.problem.reading.tables._whole import OutputTable as OutputTable
from backsight.problem.reading.tables._whole import PriorTable as PriorTable
from backsight.problem.reading.tables._whole import ProblemTable as ProblemTable
from backsight.problem.reading.tables._whole import TuneTable as TuneTable

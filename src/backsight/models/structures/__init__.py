"""Structures: by matrices, by modes, by geometry; sensors and forces at places."""

from backsight.models.forces.unknown_forces import forces_as_inputs as forces_as_inputs
from backsight.models.structures.beam import beam as beam
from backsight.models.structures.matrices import Substructure as Substructure
from backsight.models.structures.matrices import craig_bampton as craig_bampton
from backsight.models.structures.matrices import reduced as reduced
from backsight.models.structures.modal import modal as modal
from backsight.models.structures.second_order import second_order as second_order

"""Structures by matrices of finite-element models: read, checked, reduced."""

from backsight.models.structures.matrices.craig_bampton import Substructure as Substructure
from backsight.models.structures.matrices.craig_bampton import craig_bampton as craig_bampton
from backsight.models.structures.matrices.reduced import reduced as reduced

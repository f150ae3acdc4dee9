"""The lowest modes of symmetric structures."""

from backsight.models.structures.matrices.lowest_modes._lowest import LowestModes as LowestModes
from backsight.models.structures.matrices.lowest_modes._lowest import lowest as lowest

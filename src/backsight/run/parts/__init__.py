"""Estimate and smooth over recordings that are larger than memory."""

from backsight.run.parts._estimate_parts import estimate_parts as estimate_parts
from backsight.run.parts._smooth_parts import smooth_parts as smooth_parts
from backsight.run.parts._store import read_store as read_store

"""Delays between outputs and inputs, and wrong units and signs: told from what else is wrong."""

from backsight.run.diagnosis.delays._delays import check_alignment as check_alignment

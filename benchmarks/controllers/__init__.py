"""Exported code: what a fixed effort costs, what bounds say, single precision, targets."""

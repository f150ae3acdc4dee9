"""Texts: CSV, TSV and what loggers and NumPy write, and the dates in them."""

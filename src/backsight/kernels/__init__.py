"""Algorithms in C99 whose course depends on the data, compiled with the package."""

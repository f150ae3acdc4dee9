"""Estimators over very many samples, on plants that are hard on their numbers."""

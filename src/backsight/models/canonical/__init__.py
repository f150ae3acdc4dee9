"""Canonical forms of models, found from their equations."""

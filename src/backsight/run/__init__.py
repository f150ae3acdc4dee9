"""Simulate, estimate, compare, stream."""

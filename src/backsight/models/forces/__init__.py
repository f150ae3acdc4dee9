"""Forces on a model: unknown ones, those with dynamics, and those that move along a structure."""

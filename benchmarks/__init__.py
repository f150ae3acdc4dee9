"""How fast Backsight is, side by side with other software: ``python -m benchmarks``."""

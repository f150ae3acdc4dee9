"""Models from equations that are written as text."""

from backsight.models.text.equations import from_equations as from_equations

"""Configuration of the documentation."""

project = "Backsight"
author = "The Backsight developers"
extensions = ["myst_parser", "sphinx.ext.mathjax"]
myst_enable_extensions = ["dollarmath", "amsmath"]
myst_heading_anchors = 3
html_theme = "furo"
html_title = "Backsight"
exclude_patterns = ["images"]
suppress_warnings = ["myst.xref_missing"]

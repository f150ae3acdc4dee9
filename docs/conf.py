"""Configuration of the documentation."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).with_name("_extensions")))

from figures import scrape  # docs/_extensions

project = "Backsight"
author = "The Backsight developers"
project_copyright = "the Backsight developers"
extensions = [
    "mathml",
    "myst_parser",
    "reference",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
    "sphinx_design",
    "sphinx_gallery.gen_gallery",
]
exclude_patterns = ["images", "tutorials/README.txt", "theory/README.txt"]
suppress_warnings = ["myst.xref_missing", "config.cache"]

myst_enable_extensions = ["amsmath", "colon_fence", "dollarmath"]
myst_heading_anchors = 3

default_role = "py:obj"
autodoc_typehints = "none"  # the sections of the docstrings say types in words
autodoc_member_order = "bysource"
napoleon_google_docstring = False
autosummary_ignore_module_all = False

copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True

html_theme = "furo"
html_title = "Backsight"
html_math_renderer = "mathml"
html_static_path = ["_static"]
html_favicon = "_static/icon.svg"
html_css_files = ["site.css"]
html_js_files = ["site.js"]
html_theme_options = {"top_of_page_buttons": []}  # the sources are not there to be viewed

sphinx_gallery_conf = {
    "examples_dirs": ["tutorials", "theory"],
    "gallery_dirs": ["gallery", "chapters"],
    "filename_pattern": r"\.py$",
    "within_subsection_order": "FileNameSortKey",
    "image_scrapers": (scrape,),
    "reset_modules": (),
    "capture_repr": ("_repr_html_", "__str__"),
    "ignore_repr_types": r"backsight\.plot\._figures\.Drawing",
    "remove_config_comments": True,
    "show_memory": False,
    "abort_on_example_error": False,
    "download_all_examples": False,
    "min_reported_time": 1e9,
}

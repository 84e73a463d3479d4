"""The documentation site: `make docs` builds it into build/docs. Warnings are errors."""

from __future__ import annotations

import sys
from pathlib import Path

from flexdesign.core.versions import __version__

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))

project = "flexdesign"
author = "The flexdesign authors"
copyright = "the flexdesign authors"
version = release = __version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "_site.links",
    "_site.generated",
]
exclude_patterns = ["_build", "_site"]
nitpicky = False  # types of other libraries have no page here

# --- Markdown and notebooks -------------------------------------------------------------------------------------------

myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 4
# Notebooks are Markdown files with code cells. Each build executes all of them; an error in a cell fails the build.
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 240
nb_execution_show_tb = True
nb_merge_streams = True
nb_mime_priority_overrides = [("html", "text/html", 0)]

# --- Docstrings -------------------------------------------------------------------------------------------------------

autodoc_typehints = "description"
autodoc_member_order = "bysource"
napoleon_google_docstring = False
napoleon_use_ivar = True
autodoc_default_options = {"members": True, "show-inheritance": False}

# --- Pages ------------------------------------------------------------------------------------------------------------

smartquotes = False  # they would turn --out into a dash
html_theme = "furo"
html_title = f"flexdesign {__version__}"
html_copy_source = False
html_static_path = ["_site/static"]
html_css_files = ["narrow.css"]
html_show_sphinx = False

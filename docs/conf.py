"""Configuration of the documentation: `python -m sphinx -W -b html docs docs/_build` builds it, without a network."""

from __future__ import annotations

import sys
from importlib.metadata import version as installed
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

project, author, copyright = "ISPOM", "the authors of ISPOM", "the authors of ISPOM, MIT licence"
release = version = installed("ispom")
extensions = ["myst_nb", "sphinx.ext.autodoc", "generated"]
exclude_patterns = ["_build", "paper", "jupyter_execute", "_ext", "_generated", "methods/notes", "**.ipynb_checkpoints"]
myst_enable_extensions = ["colon_fence", "deflist", "dollarmath", "attrs_inline"]
myst_heading_anchors = 3
nb_execution_mode = "off"  # the notebooks are executed by tests/docs/test_notebooks.py
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_preserve_defaults = True
html_theme = "furo"
html_title = f"ISPOM {release}"
html_static_path = ["_static"]
html_css_files = ["custom.css"]
templates_path = ["_templates"]
_PARTS = ("brand", "search", "scroll-start", "navigation", "scroll-end")
html_sidebars = {"**": [*(f"sidebar/{part}.html" for part in _PARTS), "versions.html"]}
html_show_sphinx = False
html_theme_options = {"source_view_link": "", "top_of_page_buttons": []}

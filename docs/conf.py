"""Sphinx: the pages of this folder, the reference from the docstrings, and the gallery of mechanisms."""

from __future__ import annotations

import os
import re
import sys
from importlib.metadata import version as version_of
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1] / "tools"))

# Figures of a notebook are drawn in the page.
os.environ.setdefault("PLOTLY_RENDERER", "notebook")

project = "mjfish"
author = copyright = "The mjfish developers"
version = release = version_of("mjfish")

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "gallery.extension",
]
source_suffix = {".rst": "restructuredtext", ".md": "myst-nb"}
exclude_patterns = ["_build"]
html_theme = "pydata_sphinx_theme"
html_title = f"mjfish {version}"
html_theme_options = {"show_toc_level": 2, "navigation_depth": 2, "show_prev_next": False}
html_show_sourcelink = False

# Pages refer to headings of one another, as on a forge: by their words in small letters.
myst_heading_anchors = 4
myst_enable_extensions = ["dollarmath", "deflist"]
# A notebook that fails fails the build.
nb_execution_mode = "cache"
nb_execution_cache_path = str(Path(__file__).parents[1] / "out" / "docs-cache")
nb_execution_raise_on_error = True
nb_execution_timeout = 900

autosummary_generate = True
autodoc_default_options = {"members": True, "undoc-members": False}
autodoc_typehints = "description"
autodoc_member_order = "bysource"
napoleon_google_docstring = True
# Attributes are described once, on the class.
napoleon_use_ivar = True


def setup(app: Any) -> None:
    """Let an absolute value in a docstring be one: |x| is a substitution elsewhere."""
    app.connect("autodoc-process-docstring", _absolute_values)


def _absolute_values(app: Any, what: str, name: str, obj: object, options: object, lines: list[str]) -> None:
    lines[:] = [re.sub(r"\|(\w+)\|", r"\\|\1\\|", line) for line in lines]

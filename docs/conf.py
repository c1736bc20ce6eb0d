"""Configuration of Sphinx: sphinx-build -W docs docs/_build/html."""

from __future__ import annotations

import os
import sys
from importlib.metadata import version as installed
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))  # generated.py
os.environ["PATH"] = f"{Path(sys.executable).parent}:{os.environ['PATH']}"  # notebooks call palpate

project = "Palpate"
author = "The Palpate developers"
version = release = installed("palpate")

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx_click", "generated"]
exclude_patterns = ["_build"]

html_theme = "furo"
html_title = f"Palpate {version}"

smartquotes = False  # else --out becomes –out, and cannot be copied
highlight_language = "none"  # of blocks that name no language
myst_heading_anchors = 3
myst_enable_extensions = ["dollarmath"]

nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 300  # s a cell; on a quiet machine some 5
nb_execution_in_temp = True
nb_merge_streams = True

default_role = "code"  # of docstrings
autodoc_typehints = "description"
autodoc_preserve_defaults = True
autodoc_member_order = "bysource"

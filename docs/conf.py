"""Sphinx makes a site of these pages: ``make docs``, or ``sphinx-build -W docs build/docs``. No network is used."""

import os
import sys
from pathlib import Path

import trackfg

ROOT = Path(__file__).parents[1]
os.environ["PYTHONPATH"] = os.pathsep.join([str(ROOT / "tools"), os.environ.get("PYTHONPATH", "")])  # processes, too
sys.path.insert(0, str(ROOT / "tools"))

project = "trackfg"
author = "trackfg developers"
release = version = trackfg.__version__
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "numpydoc",
    "docsite",
]
root_doc = "index"
exclude_patterns = ["_build"]
highlight_language = "none"
myst_enable_extensions = ["colon_fence"]
myst_heading_anchors = 4

navigation_pages = [
    "index",
    "tutorials/README",
    "how-to",
    "concepts",
    "reference",
    "background",
    "baselines/README",
    "project/README",
]
tutorial_pages = r"tutorials/(?!README).*|adding-a-factor|own-estimator|gallery"

autosummary_generate = True
autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
python_maximum_signature_line_length = 88
python_display_short_literal_types = True
numpydoc_show_class_members = False
templates_path = ["_templates"]

# Addresses outside are not asked for: the build has no network, and publishers refuse programs.
linkcheck_ignore = [r"https?://"]

html_theme = "pydata_sphinx_theme"
html_title = "trackfg"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_js_files = ["site.js"]
html_show_sourcelink = False
html_copy_source = False
html_sidebars = {"gallery": []}
html_theme_options = {
    "logo": {"text": "trackfg"},
    "navbar_persistent": ["search-button"],
    "navbar_end": ["theme-switcher"],
    "navbar_align": "left",
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
    "pygments_light_style": "a11y-high-contrast-light",
    "pygments_dark_style": "a11y-high-contrast-dark",
    "show_toc_level": 2,
}
copyright = author

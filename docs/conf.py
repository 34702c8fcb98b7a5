"""The documentation site: `make docs` builds it from this folder, without a network."""

import os
import sys
from importlib.metadata import version as version_of
from pathlib import Path

HERE = Path(__file__).parent
os.environ["NUMBA_DISABLE_JIT"] = "1"  # compiled functions have no signature that Sphinx can read
sys.path[:0] = [str(HERE), str(HERE.parent)]

from site_docstrings import as_restructured_text, leave_out, leave_out_bounds, readable_signature  # noqa: E402
from site_math import draw_block, draw_inline  # noqa: E402
from site_pages import show_code, write_pages  # noqa: E402

project = "ortilo-drake"
author = "The ortilo-drake authors"
copyright = "2026, the ortilo-drake authors, BSD-3-Clause"
try:
    version = release = version_of("ortilo-drake")
except ModuleNotFoundError:  # a checkout that is not installed
    version = release = "unreleased"

extensions = [
    "myst_nb",
    *(f"sphinx.ext.{name}" for name in ("autodoc", "autosummary", "intersphinx", "napoleon", "viewcode")),
]
templates_path = ["_templates"]
exclude_patterns = ["_build", "_templates", "**.ipynb_checkpoints"]
default_role = "code"  # docstrings set code in single backticks
smartquotes_action = "qe"  # no dashes: --set in a help text must stay what one types
highlight_language = "none"  # a block without a language is a command, an equation or what is printed
suppress_warnings = ["ref.python"]  # names of the page Python stand in Modules as well

# --- pages -----------------------------------------------------------------------------------------------------
myst_enable_extensions = ["amsmath", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3
nb_execution_mode = "off"  # site_pages.py takes outputs from kept runs; `make docs NOTEBOOKS=1` makes those
nb_merge_streams = True
nb_render_markdown_format = "myst"  # tables in what cells print

# --- docstrings ------------------------------------------------------------------------------------------------
autosummary_generate = True
autodoc_mock_imports = ["cma", "gtsam", "rerun"]  # extras that the site is built without
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
napoleon_numpy_docstring = False  # ours are in Google's style
napoleon_attr_annotations = False  # the signature has the types
napoleon_use_ivar = True
python_use_unqualified_type_names = True
viewcode_line_numbers = True

# Types of other projects link to their own pages. What we name of them stands in inventories/, so that no network is
# needed; `make linkcheck` says whether the pages are still there.
intersphinx_mapping = {
    name: (site, f"inventories/{name}.txt")
    for name, site in (
        ("drake", "https://drake.mit.edu/pydrake/"),
        ("numpy", "https://numpy.org/doc/stable/"),
        ("pandas", "https://pandas.pydata.org/docs/"),
        ("python", "https://docs.python.org/3/"),
        ("xarray", "https://docs.xarray.dev/en/stable/"),
    )
}

# --- looks -----------------------------------------------------------------------------------------------------
html_theme = "pydata_sphinx_theme"
html_title = "ortilo-drake"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sourcelink = False
html_copy_source = False
html_math_renderer = "mathml"
html_context = {"default_mode": "auto"}
html_theme_options = {
    "navbar_align": "left",
    "collapse_navigation": True,  # three hundred modules in each page's sidebar make 70 MB
    "header_links_before_dropdown": 7,
    "show_prev_next": True,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
    "pygments_light_style": "default",
    "pygments_dark_style": "monokai",
}
html_sidebars = {page.stem: [] for page in HERE.glob("*.md")} | {"reference/settings": []}  # nothing stands below them


def setup(app) -> None:  # type: ignore[no-untyped-def]  # Sphinx is there only where the site is built
    """Give Sphinx the pages made of the program itself, its docstrings and equations without JavaScript."""
    app.add_html_math_renderer("mathml", (draw_inline, None), (draw_block, None))
    app.connect("autodoc-process-docstring", as_restructured_text, priority=400)  # before Napoleon, at 500
    app.connect("autodoc-process-signature", readable_signature)
    app.connect("autodoc-skip-member", leave_out)
    app.connect("doctree-read", show_code, priority=400)  # before Sphinx collects what is to be downloaded, at 500
    leave_out_bounds()
    write_pages(HERE)

"""Settings of the documentation site."""

import os
import sys
from importlib import metadata
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE / "_ext"), str(HERE.parent)]  # the second for `experiments`, which is not installed

# Notebooks run in kernels of their own; keep what they compile between builds.
os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(HERE.parent / ".jax_cache"))
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
# XLA's older code generator compiles in about half the time; see tests/conftest.py.
if metadata.version("jax").startswith("0.10."):
    os.environ.setdefault("XLA_FLAGS", "--xla_cpu_use_fusion_emitters=false")

import shadowjax  # noqa: E402

project = "shadowjax"
author = "the shadowjax authors"
release = shadowjax.__version__
version = release

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "sphinxcontrib.bibtex",
    "docstrings",
    "drawn_math",
    "rooms",
    "ledger_tables",
    "capability_table",
    "command_options",
    "site_check",
]
exclude_patterns = ["_build", "_ext", "_measured", "_static", "**/.ipynb_checkpoints"]

# Notebooks: MyST Markdown, executed by the build; an error in one is an error of the build.
nb_execution_mode = "cache"
nb_execution_timeout = 180
nb_execution_raise_on_error = True
nb_output_stderr = "remove"
nb_merge_streams = True
myst_enable_extensions = ["amsmath", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3

bibtex_bibfiles = ["references.bib"]
bibtex_default_style = "unsrt"

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
napoleon_google_docstring = True
napoleon_use_ivar = True
napoleon_use_rtype = False

# Formulas become drawings at build time, so that pages need nothing from elsewhere.
html_math_renderer = "drawn"
html_theme = "sphinx_book_theme"
html_title = "shadowjax"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sourcelink = False
html_theme_options = {
    "use_download_button": False,
    "use_fullscreen_button": False,
    "show_toc_level": 2,
    "home_page_in_toc": True,
    "navbar_persistent": [],
}

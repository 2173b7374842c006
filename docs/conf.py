"""How the documentation is built: `make docs`, or `sphinx-build -W --keep-going docs docs/_build/html`."""

import logging
import os
import sys
import tomllib
from pathlib import Path

from sphinx.ext.autodoc.mock import _MockModule

ROOT = Path(__file__).resolve().parent.parent
# This checkout before any that is installed.
sys.path[:0] = [str(ROOT), str(ROOT / "docs" / "_ext")]
os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))

for _package in ("robosim", "wireless", "slam", "OpenGL"):
    logging.getLogger(_package).setLevel(logging.ERROR)

_project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]

project = "robosim"
author = "The robosim authors"
copyright = "The robosim authors, Apache-2.0"
version = release = _project["version"]

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.doctest",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "sphinx_copybutton",
    "sphinx_design",
    "sphinx_gallery.gen_gallery",
    "sphinxcontrib.bibtex",
    "myst_parser",
    "matplotlib.sphinxext.plot_directive",
    "mathml",
    "docstrings",
    "commands",
    "api_pages",
    "recordings",
    "measured",
]
exclude_patterns = ["_build", "gallery/**", "**/*.inc.md", "Thumbs.db"]
templates_path = ["_templates"]
html_static_path = ["_static"]
html_css_files = ["robosim.css"]
html_theme = "furo"
html_title = f"robosim {release}"
html_theme_options = {
    "light_css_variables": {"color-brand-primary": "#0072b2", "color-brand-content": "#0072b2"},
    "dark_css_variables": {"color-brand-primary": "#56b4e9", "color-brand-content": "#56b4e9"},
}
# A page needs no files from other servers.
html_show_sphinx = False
html_copy_source = False

myst_enable_extensions = ["dollarmath", "colon_fence", "deflist", "attrs_inline", "fieldlist"]
smartquotes = False
myst_heading_anchors = 3
math_number_all = False
math_eqref_format = "({number})"
numfig = True
numfig_secnum_depth = 0
math_numfig = False

bibtex_bibfiles = ["references.bib"]
bibtex_reference_style = "author_year"
bibtex_default_style = "plain"

# Modules that train are documented without PyTorch, which the extra `docs` does not bring. Shapes need a class.
autodoc_mock_imports = ["torch"]
_MockModule.Tensor = type("Tensor", (), {"__module__": "torch"})
autodoc_member_order = "bysource"
autodoc_default_options = {"undoc-members": True}
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
autosummary_generate = True
autosummary_generate_overwrite = True
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_rtype = False
# Docstrings write names in single backticks.
default_role = "code"
python_use_unqualified_type_names = True
add_module_names = False

copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True

doctest_global_setup = "import numpy as np"

plot_html_show_source_link = False
plot_html_show_formats = False
plot_formats = [("svg", 100)]
plot_rcparams = {"font.size": 9, "svg.fonttype": "path"}
plot_apply_rcparams = True

sphinx_gallery_conf = {
    "examples_dirs": "gallery",
    "gallery_dirs": "examples",
    "filename_pattern": r"plot_",
    "within_subsection_order": "FileNameSortKey",
    "plot_gallery": os.environ.get("GALLERY", "1") != "0",
    "abort_on_example_error": True,
    "parallel": True,  # as many processes as Sphinx has
    "download_all_examples": False,
    "first_notebook_cell": "# In a new environment: %pip install robosim-wireless",
    "remove_config_comments": True,
    "show_memory": False,
    "show_signature": False,
    "min_reported_time": 0,
    "image_scrapers": ("matplotlib",),
    "matplotlib_animations": False,
    "reset_modules": ("matplotlib", "pictures.trimmed"),
    "thumbnail_size": (400, 280),
    "write_computation_times": False,
    "copyfile_regex": r".*\.rst",
}

linkcheck_timeout = 20
linkcheck_anchors = False
suppress_warnings = ["config.cache", "ref.python"]

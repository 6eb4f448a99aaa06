"""Sphinx's configuration of the documentation site: ``python -m sphinx -W docs site``."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from mocapclean import __version__

project = "mocapclean"
author = "The mocapclean authors"
project_copyright = author
version = release = __version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx_click",
    "sphinx_copybutton",
    "reference_pages",
]
smartquotes = False
exclude_patterns = ["_static", "**.ipynb_checkpoints"]
myst_enable_extensions = ["attrs_inline", "colon_fence", "deflist"]
myst_heading_anchors = 3

nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 120

autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
nitpicky = True
# Types of other packages and aliases of arrays have no page here; only names of this package must lead somewhere.
nitpick_ignore_regex = [("py:.*", r"(?!mocapclean\.).*")]

html_theme = "furo"
html_title = f"mocapclean {version}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_js_files = [("site.js", {"defer": "defer"})]
html_copy_source = False
copybutton_prompt_text = "$ "
copybutton_only_copy_prompt_lines = True

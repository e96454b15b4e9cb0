"""The documentation site: Sphinx, furo and MyST. `make docs` builds it, with every warning an error."""

import sys
import tomllib
from pathlib import Path

DOCS = Path(__file__).parent
sys.path.append(str(DOCS / "extensions"))

PROJECT = tomllib.loads((DOCS.parent / "pyproject.toml").read_text())["project"]

project = "dohyo"
author = "the authors of dohyo"
release = PROJECT["version"]
copyright = "the authors of dohyo, Apache-2.0"
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "command_reference",
    "every_module",
    "included_documents",
    "model_signatures",
]
exclude_patterns = ["extensions"]

# Pages: a link to a page or heading that is not there is a warning, and so an error.
myst_heading_anchors = 4
myst_enable_extensions = ["colon_fence"]
suppress_warnings = ["myst.header"]  # documents of the repository are included below a heading of the page

# Docstrings: Google style, shapes and names in single backticks.
default_role = "literal"
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
napoleon_attr_annotations = False
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
add_module_names = False
autodoc_default_options = {
    "members": True,
    "ignore-module-all": True,
    "exclude-members": "model_config, model_post_init",
}
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 90

html_theme = "furo"
html_title = f"dohyo {release}"
html_static_path = ["static"]
html_css_files = ["look.css"]
html_show_sphinx = False
html_copy_source = False
html_theme_options = {
    "light_css_variables": {
        "color-brand-primary": "#5B4B8A",
        "color-brand-content": "#5B4B8A",
        "color-brand-visited": "#5B4B8A",
        "color-api-name": "#5B4B8A",
        "color-api-pre-name": "#5B4B8A",
        "color-background-primary": "#FFFFFF",
        "color-background-secondary": "#FAF8F4",
        "color-background-border": "#E5E0D8",
        "color-foreground-primary": "#1F2328",
        "color-foreground-secondary": "#6B7280",
    },
    "dark_css_variables": {
        "color-brand-primary": "#A594E0",
        "color-brand-content": "#A594E0",
        "color-brand-visited": "#A594E0",
        "color-api-name": "#A594E0",
        "color-api-pre-name": "#A594E0",
        "color-background-primary": "#14161A",
        "color-background-secondary": "#1C1F25",
        "color-background-border": "#2C3038",
        "color-foreground-primary": "#E8E6E1",
        "color-foreground-secondary": "#9AA3AF",
    },
}

"""The documentation as a site: ``sphinx-build -W -c docs . site`` from the root of the repository.

The root is the source folder, so that pages link to examples and to the change log as on any host
of repositories.
"""

import sys
from importlib.metadata import version as version_of
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

project = "servo-models"
author = "The servo-models developers"
copyright = "The servo-models developers, MIT licence"
release = version = version_of("servo-models")

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "catalogue_pages",
    "reference_pages",
    "folders",
    "mathml",
]
root_doc = "docs/index"
include_patterns = [
    "docs/**",
    "examples/**",
    "studies/golden_set/*.md",
    "CHANGELOG.md",
    "CONTRIBUTING.md",
]
exclude_patterns = ["docs/_ext", "docs/_static"]
source_suffix = {".md": "markdown"}

myst_enable_extensions = ["attrs_block", "colon_fence", "dollarmath"]
myst_heading_anchors = 4
nitpicky = True
# types in signatures of docstrings: only names of the package have a page here
nitpick_ignore_regex = [("py:.*", r"(?!servo_models\.[a-z_]+$).*")]
autodoc_typehints = "none"
napoleon_use_ivar = True  # attributes as one list
autodoc_member_order = "bysource"

smartquotes = False  # two hyphens are an option of a command, no dash

html_theme = "furo"
html_title = "servo-models"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_extra_path = ["_extra"]
html_show_sourcelink = False
html_copy_source = False
html_use_index = False
highlight_language = "text"

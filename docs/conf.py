"""Sphinx settings of the site: `make docs` builds docs/ into build/site."""

import sys
from pathlib import Path

from sphinx.application import Sphinx

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))
sys.path.insert(0, str(ROOT / "docs"))

from site_fields import show_help  # noqa: E402
from site_math import add_renderer  # noqa: E402

from lensforge.verbs import UNLISTED, public_names  # noqa: E402
from lensforge.version import __version__  # noqa: E402

project = "lensforge"
version = release = __version__
project_copyright = "the authors of lensforge"
extensions = ["sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.viewcode", "myst_nb"]
html_math_renderer = "mathml"
html_theme = "furo"  # maintained, readable on a telephone, one small dependency
highlight_language = "none"  # of blocks that name none: shell, screens, drawings
html_title = f"lensforge {version}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_copyright = False
html_theme_options = {"navigation_with_keys": True}

myst_enable_extensions = ["dollarmath", "amsmath", "colon_fence", "deflist", "attrs_inline"]
myst_heading_anchors = 4
suppress_warnings = ["myst.header"]  # a gallery of one level, and pages that include others
nb_execution_mode = "off"  # notebooks are executed in the nightly run, and stored with their results
nb_merge_streams = True

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_default_options = {"members": True, "inherited-members": "BaseModel,Exception,tuple"}
napoleon_numpy_docstring = False
napoleon_use_param = napoleon_use_rtype = False  # types are words, no links
napoleon_custom_sections = [("Fields", "params_style"), ("Properties", "params_style")]
python_use_unqualified_type_names = True
nitpicky = True
# Types of other libraries: their pages cannot be asked without a network. Our own are checked.
nitpick_ignore_regex = [
    (
        "py:.*",
        r"Axes|ndarray|Figure|Path|date|Callable|Sequence|Unpack|SearchOptions|products|drawn_to_mean|None|NoneType",
    ),
    ("py:.*", r"(?!lensforge\.[A-Z])\w+\..*"),
    ("py:class", r"tuple\[~lensforge\.(results\.fact\.)?Annotated.*"),  # criteria, with how JSON holds them
    ("py:class", rf"(lensforge\.)?({'|'.join(UNLISTED.keys() - public_names().keys())})"),
]


def copy_notebooks() -> None:
    """Put the notebooks of examples/ where Sphinx finds them; git ignores the copies."""
    folder = ROOT / "docs" / "notebooks"
    folder.mkdir(exist_ok=True)
    for notebook in sorted((ROOT / "examples").glob("*.ipynb")):
        text = notebook.read_text(encoding="utf-8").replace("../docs/", "../")  # links that hold in examples/, too
        (folder / notebook.name).write_text(text, encoding="utf-8")


copy_notebooks()


def setup(app: Sphinx) -> None:
    """Show the help of public names, and write formulas as MathML."""
    show_help(app)
    add_renderer(app)

"""HTML pages: their templates and pictures, and writing a page to its file."""

import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined, Template
from markupsafe import Markup
from matplotlib.figure import Figure

from lensforge.results.fact import cells_of, columns_of
from lensforge.results.figure_style import to_svg
from lensforge.results.files import require_own, write_file

_TEMPLATES = Path(__file__).with_name("templates")


@dataclass(frozen=True)
class PagePicture:
    """A figure as SVG, a short title and a caption."""

    svg: str
    title: str
    caption: str


def picture(name: str, figure: Figure, title: str, caption: str = "") -> PagePicture:
    """``figure`` for a page; ``name`` must be unique on the page."""
    return PagePicture(to_svg(figure, name, title), title, caption)


def template(name: str) -> Template:
    """The template ``name``; text is escaped, and a variable without a value is an error."""
    return _environment().get_template(name)


@cache
def _environment() -> Environment:
    """The templates, each compiled once for all pages of a process: that takes a second."""
    environment = Environment(
        loader=FileSystemLoader(_TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["breakable"] = _breakable
    environment.globals.update(columns_of=columns_of, cells_of=cells_of)
    return environment


def write_page(page: str, path: Path) -> None:
    """Write ``page`` to ``path``. Raises :class:`InputError` where that file is not one of this program's."""
    require_own(path)
    write_file(path, page.encode())


def _breakable(path: str) -> Markup:
    """A dotted path that may wrap after its dots and underscores, and nowhere else."""
    return Markup("<wbr>").join(re.split(r"(?<=[._])", path))


def numbered(name: str, index: int) -> str:
    """Name of a picture of receiver number ``index``, unique on the page; of the first it is ``name`` itself."""
    return f"{name}-{index + 1}" if index else name

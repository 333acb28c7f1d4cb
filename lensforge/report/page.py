"""How values enter a page, and how a page enters its file."""

import re
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined, Template
from markupsafe import Markup

from lensforge.files import replacing
from lensforge.report.pdf import drop_stale

_TEMPLATES = Path(__file__).with_name("templates")


def template(name: str) -> Template:
    """The template ``name``; text is escaped, and a name that has no value is an error."""
    environment = Environment(
        loader=FileSystemLoader(_TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["breakable"] = _breakable
    return environment.get_template(name)


def write_page(page: str, path: Path) -> None:
    """Write ``page`` to ``path``; the PDF of an earlier page goes."""
    with replacing(path) as temporary:
        temporary.write_text(page, encoding="utf-8")
    drop_stale(path)


def _breakable(path: str) -> Markup:
    """A dotted path that may wrap after its dots and underscores, and nowhere else."""
    return Markup("<wbr>").join(re.split(r"(?<=[._])", path))

"""How values enter a page: the templates and their filters."""

import re

from jinja2 import Environment, PackageLoader, StrictUndefined, Template
from markupsafe import Markup


def template(name: str) -> Template:
    """The template ``name``; text is escaped, and a name that has no value is an error."""
    environment = Environment(
        loader=PackageLoader("lensforge.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["breakable"] = _breakable
    return environment.get_template(name)


def _breakable(path: str) -> Markup:
    """A dotted path that may wrap after its dots and underscores, and nowhere else."""
    return Markup("<wbr>").join(re.split(r"(?<=[._])", path))

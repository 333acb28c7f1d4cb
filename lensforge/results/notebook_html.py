"""Displays of a result: HTML for a notebook (table, section as SVG, plot as image), text, files, ``help``."""

import base64
import io
import itertools
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from html import escape
from inspect import Parameter, Signature
from types import FunctionType
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float
from pydantic import BaseModel

from lensforge.errors import shortened
from lensforge.results.field_help import class_help

if TYPE_CHECKING:
    from pydantic._internal._model_construction import ModelMetaclass as _Metaclass
else:
    _Metaclass = type(BaseModel)  # which has no public name

# A text of a result fits on a screen.
MOST_LINES = 40
_MOST_CHARACTERS = 100
_LONG_TEXT = 200  # characters that a terminal shows of a field
_LONG_LIST = 8  # entries
PLOT_KINDS = ("png", "svg", "pdf")
_DATE = {"png": "Software", "svg": "Date", "pdf": "CreationDate"}  # metadata that would differ from file to file


def table_html(facts: Mapping[str, str]) -> str:
    """A table with one row for each of ``facts``: name and text."""
    cells = (f"<tr><th>{escape(name)}</th><td>{escape(text)}</td></tr>" for name, text in facts.items())
    return f"<table>{''.join(cells)}</table>"


def table_text(title: str, facts: Mapping[str, str]) -> str:
    """A title and a line for each of ``facts``, up to a screenful."""
    width = max(map(len, itertools.islice(facts, MOST_LINES)), default=0)
    rows = (f"  {name:<{width}}  {shortened(' '.join(text.split()), _MOST_CHARACTERS)}" for name, text in facts.items())
    return screenful([title, *rows])


def screenful(lines: Sequence[str]) -> str:
    """``lines`` as a text, up to a screenful."""
    left = len(lines) - MOST_LINES
    return "\n".join(lines if left <= 0 else [*lines[: MOST_LINES - 1], f"  and {left + 1} more"])


@dataclass(frozen=True)
class Brief:
    """A short text in place of a value too long for a terminal."""

    text: str

    @staticmethod
    def of(value: object) -> object:
        """``value``, or a text on its size."""
        if isinstance(value, np.ndarray):
            return Brief(f"<{' x '.join(map(str, value.shape))} numbers>")
        if isinstance(value, str | bytes) and len(value) > _LONG_TEXT:
            return Brief(f"<{len(value)} {'bytes' if isinstance(value, bytes) else 'characters'}>")
        if isinstance(value, tuple | Mapping) and len(value) > _LONG_LIST:
            return Brief(f"<{len(value)} entries>")
        return value

    def __repr__(self) -> str:
        return self.text


# Members by which records are made, read, written and drawn: no part of what a script uses.
_MACHINERY = re.compile(
    "_.*|body_at|cases|changed|chart|contents|face_of|file_names|follows|joined|light_chart|of|plain|plotted|products|read|"
    "rebuild_command|renamed|same_as|schema_name|sha256|shown_row|stems|stored_elsewhere|with_parts|with_worst|without_noise|write"
)
_MEMBERS = (FunctionType, classmethod, staticmethod, property, cached_property)


class Shown(_Metaclass):
    """Limits ``help`` and completion of a class to its fields with their descriptions, and to members for scripts."""

    @property
    def __doc__(cls) -> str | None:  # type: ignore[override]  # noqa: N805
        """Made on demand: for all classes it would take a second of every start."""
        return class_help(cls)

    @property
    def __signature__(cls) -> Signature:  # noqa: N805
        return Signature([Parameter("fields", Parameter.VAR_KEYWORD)])

    @__signature__.setter
    def __signature__(cls, value: object) -> None:  # noqa: N805
        """Leave out pydantic's own, which a class has only once it has been used."""

    def __dir__(cls) -> list[str]:  # noqa: N805
        of_all = frozenset(dir(BaseModel))
        members = (item for base in cls.__mro__ for item in vars(base).items() if item[0] not in of_all)
        return [name for name, member in members if isinstance(member, _MEMBERS) and not _MACHINERY.fullmatch(name)]


def section_html(title: str, outline: Float[np.ndarray, "n 2"], facts: Mapping[str, str]) -> str:
    """A title, the section with ``outline`` (x, z in mm) to scale, and a table of ``facts``."""
    return f"<div><strong>{escape(title)}</strong>{_section_svg(outline)}{table_html(facts)}</div>"


def plot_html(draw: Callable[..., Any], description: str) -> str:
    """The plot that ``draw`` makes on new axes, as an image."""
    encoded = base64.b64encode(plot_file(draw, "png")).decode()
    return f'<img alt="{description}" style="max-width:30em" src="data:image/png;base64,{encoded}">'


def plot_file(draw: Callable[..., Any], kind: str) -> bytes:
    """The plot that ``draw`` makes on new axes, as a file of ``kind``; the same result gives the same bytes."""
    import matplotlib.style
    from matplotlib.figure import Figure

    style = {"svg.hashsalt": "lensforge"}  # else each file has ids of its own
    with matplotlib.style.context(["default", style]):  # whatever a matplotlibrc says
        # "constrained" takes axes of a fixed aspect for wider than they become, and cuts the label beside them
        figure = Figure(figsize=(5.0, 4.0), layout="compressed")
        file = io.BytesIO()
        draw(axes=figure.add_subplot())
        figure.savefig(file, format=kind, dpi=150, metadata={_DATE[kind]: None})
        return file.getvalue()


def _section_svg(outline: Float[np.ndarray, "n 2"]) -> str:
    """The section, outlined in the text colour; y is flipped because in SVG it points downwards."""
    reach = 1.05 * float(np.abs(outline).max())
    points = " ".join(f"{x:.4g},{-z:.4g}" for x, z in outline)
    return (
        f'<svg role="img" aria-label="section" viewBox="{-reach:.4g} {-reach:.4g} {2 * reach:.4g} {1.05 * reach:.4g}" '
        f'width="320" style="display:block"><polygon points="{points}" fill="#2f7fd1" fill-opacity="0.2" '
        f'stroke="currentColor" stroke-width="{0.012 * reach:.4g}"/></svg>'
    )

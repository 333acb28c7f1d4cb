"""Pages with empty pictures, for tests that read their words and numbers: drawing takes four seconds a page."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

import pytest
from matplotlib.figure import Figure

from lensforge.report import lens_page
from lensforge.report.solid_view import SolidViews


@contextmanager
def without_views() -> Iterator[None]:
    """Reports without three-dimensional views, which take a process and seconds."""
    none = SolidViews({}, problem="No 3-D picture: not drawn.")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(lens_page, "solid_views", lambda *_: none)
        yield


@contextmanager
def undrawn() -> Iterator[None]:
    """Reports whose every picture is an empty element with its title; no function of the report draws."""
    with without_views(), without_figures():
        yield


@contextmanager
def without_figures() -> Iterator[None]:
    """The same for pictures of two dimensions alone."""
    with pytest.MonkeyPatch.context() as patch:
        for name, module in list(sys.modules.items()):
            if name.startswith("lensforge.report.") or name == "lensforge.shop.surface_figures":
                for key, value in list(vars(module).items()):
                    if key == "to_svg":
                        patch.setattr(module, key, _empty_picture)
                    elif getattr(value, "__annotations__", {}).get("return") is Figure:
                        patch.setattr(module, key, _empty_figure)
        yield


def _empty_figure(*_: Any, **__: Any) -> Figure:
    """One figure for all: axes take 10 ms to make, and a page has thirty."""
    return _one_figure()


@cache
def _one_figure() -> Figure:
    figure = Figure()
    figure.add_subplot()  # whose limits a page may set
    return figure


def _empty_picture(figure: Figure, name: str, description: str) -> str:
    return f'<svg role="img" id="{name}"><title>{description.replace("<", "&lt;")}</title></svg>'

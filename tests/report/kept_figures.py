"""Figures of a page with their titles, made but not drawn."""

from contextlib import contextmanager

import pytest


@contextmanager
def kept_figures():
    """A dict of names with titles and figures, which fills with those of the pages made meanwhile."""
    figures = {}

    def keep(figure, name, title):
        assert name not in figures
        figures[name] = (title, figure)
        return "<svg></svg>"

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("lensforge.report.pictures.to_svg", keep)
        yield figures

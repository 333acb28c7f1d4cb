"""Formulas as MathML, which browsers draw by themselves: the site needs no script from elsewhere."""

from typing import Any

from docutils import nodes
from docutils.utils.math import latex2mathml


def _visit(self: Any, node: nodes.Element, *, block: bool) -> None:
    markup = latex2mathml.tex2mathml(node.astext(), as_block=block)
    self.body.append(f'<div class="formula">{markup}</div>' if block else markup)
    raise nodes.SkipNode


def visit_inline(self: Any, node: nodes.Element) -> None:
    """Write a formula within a line."""
    _visit(self, node, block=False)


def visit_block(self: Any, node: nodes.Element) -> None:
    """Write a formula of its own."""
    _visit(self, node, block=True)


def add_renderer(app: Any) -> None:
    """Connect with Sphinx, as `html_math_renderer = "mathml"`."""
    app.add_html_math_renderer("mathml", (visit_inline, None), (visit_block, None))
